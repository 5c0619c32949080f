# SPDX-License-Identifier: Apache-2.0
"""Probabilities that are fitted to the map's own counts.

The textbook's log odds add a fixed amount for each hit and each pass, as though beams were
independent, and so become certain of what is not. Two questions, two answers:

- Is something there? p(occupied): the Bayes factor of occupied cells against others, from the
  distributions of counts of both (`count_model`), takes the place of the fixed amounts:

    l = logit(prior) + log p(hits, passes | occupied) - log p(hits, passes | not occupied).

- How often will it reflect a beam? `reflectivity`: Beta(a + hits, b + passes), with the prior under
  which the counts of all cells are most probable.

Both are functions of a cell's hits and passes alone: merging, saving, the order of readings and
another prior are as with log odds. What is fitted is fitted when the view is made.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.evidence.evidence import Evidence
from oddsmap.odds import Thresholds
from oddsmap.posterior.beta import beta_interval
from oddsmap.posterior.count_fit import fit_beta, fit_model
from oddsmap.posterior.count_model import CountModel
from oddsmap.posterior.count_pairs import count_pairs
from oddsmap.posterior.count_view import CountView
from oddsmap.posterior.log_odds import LogOdds
from oddsmap.posterior.prior import MapLike
from oddsmap.posterior.reflection import Reflection
from oddsmap.posterior.vote_table import VoteTable

if TYPE_CHECKING:
    from oddsmap.map_files.npz import Column

__all__ = ["LEVEL", "Calibrated"]

LEVEL = 0.95
"""Mass of the reflectivity's interval."""

_REFLECTIVITY = np.dtype([(name, np.float32) for name in ("mean", "low", "high")])


class Calibrated(CountView):
    """p(occupied) and reflectivity of each cell, calibrated by the map's own counts.

    Regions as in `Belief`; known cells are those with evidence.

    Args:
        evidence: the map. What is added to it later shows in the view, under the parameters that
            were fitted before.

    Other Args:
        prior: p(x) of every cell, or a map of it; default: the share of occupied cells among the
            known ones, as fitted.
        thresholds: from which probabilities a cell is free or occupied; default: the map's.
        clamp: lowest and highest probability of the view; None: as they are.
        model: what was fitted to another map, to be used for this one.

    Attributes:
        model: how reflectivities are distributed among cells, and which cells are occupied.
        reflectivity: how often a beam is reflected: a `Reflection` view with the fitted prior.

    Raises:
        ConfigError, InputError: as in `LogOdds`.
    """

    def __init__(
        self,
        evidence: Evidence,
        *,
        prior: float | MapLike | None = None,
        thresholds: Thresholds | None = None,
        clamp: tuple[float, float] | None = None,
        model: CountModel | None = None,
    ) -> None:
        if evidence.sensor.kind == "cone":
            warnings.warn(
                "counts say little under wide beams, whose hits belong to one cell of many: "
                "oddsmap.build_full_map estimates all cells together",
                stacklevel=2,
            )
        if isinstance(prior, Evidence):
            prior = LogOdds(prior, prior=evidence.config.posterior.prior)
        pairs = count_pairs(evidence)
        self.model = model or fit_model(pairs)
        super().__init__(
            evidence,
            prior=self.model.occupied_share if prior is None else prior,
            thresholds=thresholds,
            clamp=clamp,
        )
        a, b = fit_beta(pairs)
        with warnings.catch_warnings():
            # A pair of votes a scan is what was fitted: no comparison with single beams is made.
            warnings.simplefilter("ignore")
            self.reflectivity = self._reflection((a, b))

    def _reflection(self, beta: tuple[float, float]) -> Reflection:
        return Reflection(self.evidence, a=beta[0], b=beta[1], level=LEVEL)

    def increment(self, hits: npt.ArrayLike, passes: npt.ArrayLike) -> FloatArray:
        """The log Bayes factor of weights of hits and passes [votes]; 0 for none."""
        return self.model.log_bayes_factor(hits, passes)

    def _settings(self) -> tuple[object, ...]:
        return (*super()._settings(), self.model)

    def _extra_columns(self) -> dict[str, Column]:
        """Mean reflectivity with its 95 % interval."""
        from oddsmap.map_files.npz import Column

        tiles, count = self.evidence.tiles, self.evidence.cell_count()
        table = VoteTable(self._reflectivity)

        def column(name: str) -> Column:
            return Column((count,), lambda: (table(h, p)[name] for _, h, p in tiles.parts()))

        names = {"mean": "reflectivity", "low": "reflectivity_low", "high": "reflectivity_high"}
        return {name: column(key) for key, name in names.items()}

    def _reflectivity(self, hits: FloatArray, passes: FloatArray) -> npt.NDArray[np.void]:
        alpha, beta = self.reflectivity.a + hits, self.reflectivity.b + passes
        values = np.empty(len(hits), _REFLECTIVITY)
        values["mean"] = alpha / (alpha + beta)
        values["low"], values["high"] = beta_interval(alpha, beta, LEVEL)
        return values
