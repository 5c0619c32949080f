# SPDX-License-Identifier: Apache-2.0
"""How a sensor's parameters are renewed from readings predicted without themselves."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from oddsmap.forward.model import ForwardModel
from oddsmap.scoring.search import climb

if TYPE_CHECKING:
    from oddsmap.scoring.leave_one_out import Work

__all__ = ["NOISE", "Fit"]

NOISE = ("p_random", "p_dropout", "sigma")
"""What every sensor with a forward model has; cones also have `cone_deg`."""

_SWEEPS, _MORE_SWEEPS = 6, 3
# Updates end where no parameter moves by more than this; sigma: as a share.
_RESTS = 5e-4
_SIGMA_RESTS = 5e-3
# Of p_random and p_dropout: at 0 one odd reading would veto a cell forever.
_LEAST_RATE = 1e-4
# log2 of how abruptly echoes set in at the cone's edge, and how far the search may go.
_STEEPEST = 4.0


@dataclass(slots=True, eq=False)
class Fit:
    """The parameters so far, and how each is renewed.

    Args:
        work: the map, and the readings predicted from it.
        model: the sensor so far.
        beams: how many readings.
        max_updates: of the noise's parameters, in a row.
        progress: called after each step with what was done and the mean log likelihood.
        edge: how abruptly echoes set in at the edge of the cone, see `LeaveOneOut.settle`.
        updates: of the noise's parameters so far.
        converged: whether they have come to rest.
        errors: standard errors of what has been searched.
    """

    work: Work
    model: ForwardModel
    beams: int
    max_updates: int
    progress: Callable[[str, float], None] | None
    edge: float = 1.0
    updates: int = 0
    converged: bool = False
    errors: dict[str, float] = dataclasses.field(default_factory=dict)

    def settle(self) -> None:
        """Estimate the map anew."""
        self.work.settle(self.model, self.edge, _SWEEPS)

    def renew_noise(self) -> None:
        """Expectation maximisation, the map following the parameters.

        p_dropout stays as it is where there is no no-return to tell it from.
        """
        from oddsmap.kernels.infer.responsibilities import DROPOUT, LIKELIHOOD, RANDOM, SQUARES

        some_no_returns = bool(self.work.no_returns.any())
        for _ in range(self.max_updates):
            found = self.work.causes(self.model)
            # What no-returns are not by dropout was an echo out of reach, and says nothing about
            # the noise: their squares are 0, and so is their weight.
            true = np.where(self.work.no_returns, 0.0, 1.0 - found[:, RANDOM])
            old, model = self.model, self.model
            sigma = math.sqrt(found[:, SQUARES].sum() / true.sum())
            # Without any no-return the log says nothing about dropouts: p_random is then a share of
            # the remainder.
            p_random, p_dropout = float(found[:, RANDOM].mean()), model.p_dropout
            if some_no_returns:
                p_dropout = max(float(found[:, DROPOUT].mean()), _LEAST_RATE)
            else:
                p_random *= 1.0 - p_dropout
            self.model = dataclasses.replace(
                model,
                p_random=max(p_random, _LEAST_RATE),
                p_dropout=p_dropout,
                sigma=max(sigma, float(model.bin_width or 0.0) / 2.0),
            )
            self.updates += 1
            self._say("noise", float(np.log(found[:, LIKELIHOOD]).mean()))
            self.work.go_on(self.model, _MORE_SWEEPS)
            self.converged = (
                abs(self.model.p_random - old.p_random) < _RESTS
                and abs(self.model.p_dropout - old.p_dropout) < _RESTS
                and abs(self.model.sigma / old.sigma - 1.0) < _SIGMA_RESTS
            )
            if self.converged:
                return

    def search_edge(self, angle: float, share: float) -> None:
        """How abruptly echoes set in, the width at half the chance of an echo held.

        A cell takes up `angle` [deg]; a wall's echoes set in where its centre is inside of
        cone_deg + angle (1 - 1 / edge), so that the two are searched along that ridge.
        """
        wide = self.model.cone_deg + angle * (1.0 - 1.0 / self.edge)

        def value(log2_edge: float) -> float:
            edge = 2.0**log2_edge
            return self._try(self._cone(wide - angle * (1.0 - 1.0 / edge)), edge)

        peak = climb(value, math.log2(self.edge), 1.0 * share, 0.0, _STEEPEST)
        self.edge = 2.0**peak.place
        self.model = self._cone(wide - angle * (1.0 - 1.0 / self.edge))
        self._say("edge", peak.value / self.beams)

    def search_cone(self, angle: float, share: float) -> None:
        """The width of the cone."""
        step = share * min(angle, self.model.cone_deg / 4.0)
        peak = climb(
            lambda cone: self._try(self._cone(cone), self.edge),
            self.model.cone_deg, step, self.model.cone_deg / 4.0, 180.0,
        )  # fmt: skip
        self.model = self._cone(peak.place)
        self.errors["cone_deg"] = peak.error
        self._say("cone_deg", peak.value / self.beams)

    def search_detection(self, share: float) -> None:
        """The chance that an occupied cell echoes."""
        peak = climb(
            lambda chance: self._try(
                dataclasses.replace(self.model, detection=chance), self.edge
            ),
            self.model.detection, 0.06 * share, 0.05, 1.0,
        )  # fmt: skip
        self.model = dataclasses.replace(self.model, detection=peak.place)
        self.errors["detection"] = peak.error
        self._say("detection", peak.value / self.beams)

    def noise_errors(self) -> dict[str, float]:
        """Standard errors of the noise's parameters that were renewed, the map held."""
        best = self.work.log_likelihood(self.model)
        errors = {}
        for name in NOISE:
            if name == "p_dropout" and not self.work.no_returns.any():
                continue
            value = getattr(self.model, name)
            step = 0.05 * value
            if step < 1e-5 or value <= _LEAST_RATE:
                errors[name] = math.nan
                continue
            sides = [
                self.work.log_likelihood(dataclasses.replace(self.model, **{name: value + off}))
                for off in (-step, step)
            ]
            information = (2.0 * best - sum(sides)) / step**2
            errors[name] = 1.0 / math.sqrt(information) if information > 0.0 else math.nan
        return errors

    def _try(self, model: ForwardModel, edge: float) -> float:
        self.work.settle(model, edge, _SWEEPS)
        return self.work.log_likelihood(model)

    def _cone(self, degrees: float) -> ForwardModel:
        return dataclasses.replace(self.model, cone_deg=min(max(degrees, 0.1), 180.0))

    def _say(self, what: str, log_likelihood: float) -> None:
        if self.progress is not None:
            self.progress(what, log_likelihood)
