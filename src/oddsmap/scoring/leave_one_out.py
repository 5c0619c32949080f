# SPDX-License-Identifier: Apache-2.0
"""Readings predicted from the map without them: what the sensor's parameters are judged by.

Message passing knows what the map believes without any one beam: take the beam's own messages out
of the belief of its cells (the cavity). So

    sum over beams of log p(z_b | z_-b, parameters)

costs no more than a sweep. It is a pseudo-likelihood (Besag, Statistical analysis of non-lattice
data, 1975): a beam is never asked about a map that it has shaped itself.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.config.full_map import FullMapConfig
from oddsmap.forward.beam_rows import list_rows
from oddsmap.forward.beams import Beams
from oddsmap.forward.cell_grid import CellField
from oddsmap.forward.model import ForwardModel
from oddsmap.full_map.belief_propagation import Propagation
from oddsmap.kernels.infer.beam_factor import NAT
from oddsmap.kernels.infer.responsibilities import LIKELIHOOD, causes
from oddsmap.odds import sigmoid

__all__ = ["LeaveOneOut", "Work", "is_listed_for"]


# Cells are listed anew where range noise is so much larger, or smaller, than it was.
_LARGER, _SMALLER = 1.1, 0.6


class Work(Protocol):
    """What `fit.Fit` asks of a map and the readings predicted from it: as `LeaveOneOut` has it."""

    no_returns: npt.NDArray[np.bool_]

    def settle(self, model: ForwardModel, edge: float, sweeps: int) -> None:
        """Estimate the map anew."""

    def go_on(self, model: ForwardModel, sweeps: int) -> None:
        """Estimate the map under another model of the same cone, from where it is."""

    def causes(self, model: ForwardModel) -> FloatArray:
        """Likelihood and causes of each beam's reading."""
        ...

    def log_likelihood(self, model: ForwardModel) -> float:
        """Of all readings together."""
        ...


def is_listed_for(model: ForwardModel, cone_deg: float, sigma: float) -> bool:
    """Whether cells that were listed for a width and a noise serve a model."""
    return cone_deg == model.cone_deg and _SMALLER * sigma <= model.sigma <= _LARGER * sigma


class LeaveOneOut:
    """A map of all beams, and each beam's reading predicted from the others.

    Args:
        beams: those that carry information.
        resolution: side of a cell [m].
        settings: how beliefs are propagated; the number of sweeps is not looked at.
        threads: how many to work with.

    Attributes:
        no_returns: True where a beam saw nothing, shape (beams,).
    """

    def __init__(
        self, beams: Beams, resolution: float, settings: FullMapConfig, threads: int = 1
    ) -> None:
        self._beams, self._resolution = beams, resolution
        self._settings, self._threads = settings, threads
        # Cone width and range noise that the cells have been listed for.
        self._listed = (math.nan, math.nan)
        self.no_returns = ~np.isfinite(beams.ranges)

    def settle(self, model: ForwardModel, edge: float, sweeps: int) -> None:
        """Estimate the map anew.

        Args:
            model: the sensor.
            edge: how abruptly echoes set in at the edge of the cone: an occupied cell echoes with
                detection * min(1, edge * fraction).
            sweeps: how many.
        """
        self._list(model)
        rows = self._all_rows
        self._rows = rows._replace(
            fractions=np.minimum(1.0, edge * rows.fractions).astype(np.float32)
        )
        self._field.belief[:] = self._field.start
        self._field.received[:] = 0
        self._messages = np.zeros(len(rows.cells), np.int32)
        self._edge = edge
        self.go_on(model, sweeps)

    def go_on(self, model: ForwardModel, sweeps: int) -> None:
        """Renew the messages under another model of the same cone, from where they are.

        Cells are listed anew, and the map is begun anew, where the range noise asks for it.
        """
        if not self._is_listed_for(model):
            self.settle(model, self._edge, 2 * sweeps)
            return
        work = Propagation(
            self._field, self._rows, model.noise(self._resolution), np.array([model.detection]),
            self._settings, self._threads,
        )  # fmt: skip
        work.messages[:] = self._messages
        for _ in range(sweeps):
            work.sweep()
        self._messages = work.messages

    def causes(self, model: ForwardModel) -> FloatArray:
        """Likelihood and causes of each beam's reading, see `kernels.infer.responsibilities`."""
        out = np.empty((len(self._beams), 4))
        causes(
            self._rows, model.noise(self._resolution), np.array([model.detection]),
            self._field.belief, self._messages, out,
        )  # fmt: skip
        return out

    def cells(self) -> tuple[IntArray, FloatArray]:
        """Index of each cell, shape (n, d), x first, and p(occupied), shape (n,), of all beams."""
        index = self._field.index(np.arange(len(self._field.belief)))
        return index, sigmoid(self._field.belief / NAT)

    def log_likelihood(self, model: ForwardModel) -> float:
        """Sum over beams of the log density [1/m] of a reading, or probability of a no-return."""
        likelihood = self.causes(model)[:, LIKELIHOOD]
        returns = np.count_nonzero(self._beams.ranges < model.range_max)
        width = model.bin_width_at(self._resolution)
        return float(np.log(likelihood).sum() - returns * math.log(width))

    def _is_listed_for(self, model: ForwardModel) -> bool:
        return is_listed_for(model, *self._listed)

    def _list(self, model: ForwardModel) -> None:
        if self._is_listed_for(model):
            return
        prior = self._settings.prior_in(self._beams.ndim)
        self._field = CellField(self._beams.ndim, round(math.log(prior / (1.0 - prior)) * NAT))
        self._all_rows = list_rows(self._field, self._beams, model, self._resolution)
        self._listed = (model.cone_deg, model.sigma)
