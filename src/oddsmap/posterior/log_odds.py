# SPDX-License-Identifier: Apache-2.0
"""The posterior of the recursive binary Bayes filter, as a view of the evidence.

Each reading adds a log Bayes factor to the cells that it speaks of,

    l_t = l_{t-1} + log p(x | z) / p(not x | z) - log p(x) / p(not x),

and adds nothing anywhere else. The factors of hits are all alike, and so are those of passes, so
the sum needs no recursion:

    l = logit(prior) + l_occ * hits - l_free * passes,

l_occ = logit(p_hit), l_free = -logit(p_miss), with p_hit and p_miss the inverse sensor model at
prior 1/2. Sensor model and prior can be changed after mapping. The prior is one number, or a map
of its own: a cell without evidence has a sum of exactly zero, and so keeps its prior to the bit.

Source: Thrun, Burgard, Fox: Probabilistic Robotics (2005), table 9.1 and equation 9.7.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError
from oddsmap.evidence.evidence import Evidence
from oddsmap.odds import Thresholds, logit
from oddsmap.posterior.count_view import CountView
from oddsmap.posterior.prior import MapLike

__all__ = ["LogOdds"]


class LogOdds(CountView):
    """p(m | z_1:t) of each cell, cells independent of each other.

    Regions as in `Belief`; known cells are those with evidence.

    Args:
        evidence: the map; what is added to it later shows in the view.

    Other Args:
        p_hit: p(x | z) of a hit at prior 1/2; default: the map's sensor model.
        p_miss: p(x | z) of a pass at prior 1/2; likewise.
        prior: p(x) of every cell, or a map of it (`ProbabilityMap`, another map or view,
            `VoxelMap`, `PriorArray`: see `oddsmap.posterior.prior.PriorMap`), the cells that it
            does not know having the configuration's; default: the map's configuration.
        thresholds: the probabilities from which a cell counts as free or occupied; likewise.
        clamp: lowest and highest probability of this view, None: as they are. It bounds the sum
            of all evidence. That is not what a filter does that clamps after each update: its
            result depends on the order of the readings, this one does not.

    Attributes:
        prior: p(x) of cells that no prior map knows.
        prior_map: the prior map; None where all cells have `prior`.

    Raises:
        ConfigError: a probability is outside its range.
        InputError: the prior map does not fit.
    """

    def _facts(self) -> Iterator[str]:
        yield from super()._facts()
        yield f"p_hit {self.p_hit:g}, p_miss {self.p_miss:g}"

    def __init__(
        self,
        evidence: Evidence,
        *,
        p_hit: float | None = None,
        p_miss: float | None = None,
        prior: float | MapLike | None = None,
        thresholds: Thresholds | None = None,
        clamp: tuple[float, float] | None = None,
    ) -> None:
        self.p_hit = evidence.sensor.p_hit if p_hit is None else p_hit
        self.p_miss = evidence.sensor.p_miss if p_miss is None else p_miss
        for name in ("p_hit", "p_miss"):
            value = getattr(self, name)
            if not 0.0 < value < 1.0:
                raise ConfigError(f"{name} is a probability between 0 and 1, got {value}")
        if not self.p_miss < 0.5 < self.p_hit:
            raise ConfigError(
                f"a hit must speak for and a pass against a cell: p_miss < 0.5 < p_hit, "
                f"got p_miss {self.p_miss} and p_hit {self.p_hit}"
            )
        if isinstance(prior, Evidence):
            prior = LogOdds(prior, prior=evidence.config.posterior.prior)
        super().__init__(evidence, prior=prior, thresholds=thresholds, clamp=clamp)

    def increment(self, hits: npt.ArrayLike, passes: npt.ArrayLike) -> FloatArray:
        """What weights of hits and passes [votes] add to the prior's log odds; 0 for none."""
        gain = float(logit(self.p_hit)) * np.asarray(hits, np.float64)
        loss = float(logit(self.p_miss)) * np.asarray(passes, np.float64)
        return gain + loss

    def _settings(self) -> tuple[object, ...]:
        return (*super()._settings(), self.p_hit, self.p_miss)
