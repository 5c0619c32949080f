# SPDX-License-Identifier: Apache-2.0
"""The settings of full-map estimation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from oddsmap.errors import ConfigError
from oddsmap.short_repr import short_repr

__all__ = ["METHODS", "PRIOR_MODELS", "SCHEDULES", "FullMapConfig"]

METHODS = ("sum-product", "gibbs", "map")
PRIOR_MODELS = ("ising", "windows")
SCHEDULES = ("chunks", "sequential", "parallel")

# As for a beam's message: all that 31 bits hold, with room to spare. No neighbour is so sure.
_MAX_COUPLING = 64.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FullMapConfig:
    """How beliefs are propagated, and what is made of them.

    Args:
        method: "sum-product": the marginals by loopy belief propagation. "gibbs": the marginals
            by Gibbs sampling, exact but for chance in the long run: the reference, a few times
            slower and on one thread. "map": one map that no single cell can improve, by hill
            climbing. These two start from where sum-product ends, with the fields below.
        prior: p(x) of a cell before any reading and before its neighbours are considered; None:
            0.475 in 2D, 0.1 in 3D. Hundreds of unseen cells share a cone: if each is believed to
            be occupied a little, a beam that nothing returned is taken for a dropout.
        coupling: strength J of the Ising prior exp(J [m_i = m_j]) on cells that share a side; None:
            0.8 in 2D, 0.4 in 3D, by the sonar benchmark and by held-out readings. Belief
            propagation takes sides by itself from ln 2 = 0.69 in 2D and ln 1.5 = 0.41 in
            3D: there, cells that no beam observes drift together, which `FullMap` marks.
        prior_model: "ising": `prior` and `coupling`, as above. "windows": for "gibbs" in 2D, what
            3 x 3 windows of cells look like in buildings and among obstacles, learnt with cells of
            0.1 m; `prior` and `coupling` then say where the chain starts, and what a cell that no
            beam lists has.
        sweeps: the maximum number of sweeps over all beams.
        tolerance: sweeps end once messages change by less than this on average [nats]: those of
            beams, and those between neighbours.
        schedule: in which order messages are renewed. "sequential": beam after beam. "chunks":
            some hundred beams of a random order at a time, which threads share. "parallel": all
            beams at once, damped by one half.
        chunk: beams of a chunk, at most; never more than one in 64 of all.
        seed: of the random order, and of Gibbs sampling.
        samples: "gibbs": sweeps that are counted, each of which draws every cell once.
        burn_in: "gibbs": sweeps before those, which are forgotten.

    Raises:
        ConfigError: a value is outside its range.
    """

    method: str = "sum-product"
    prior: float | None = None
    coupling: float | None = None
    prior_model: str = "ising"
    sweeps: int = 40
    tolerance: float = 2e-3
    schedule: str = "chunks"
    chunk: int = 512
    seed: int = 0
    samples: int = 100
    burn_in: int = 20

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.prior is not None and not 0.0 < self.prior < 1.0:
            raise ConfigError(f"full_map.prior lies between 0 and 1, got {self.prior}")
        if self.coupling is not None and not 0.0 <= self.coupling <= _MAX_COUPLING:
            raise ConfigError(
                f"full_map.coupling lies between 0 and {_MAX_COUPLING:g}, got {self.coupling}"
            )
        if not 0.0 <= self.tolerance < math.inf:
            raise ConfigError(f"full_map.tolerance is 0 nats or more, got {self.tolerance}")
        for name, minimum in (
            ("sweeps", 1), ("chunk", 1), ("seed", 0), ("samples", 1), ("burn_in", 0)
        ):  # fmt: skip
            value = getattr(self, name)
            if value < minimum:
                raise ConfigError(f"full_map.{name} is at least {minimum}, got {value}")
        for name, known in (
            ("method", METHODS), ("prior_model", PRIOR_MODELS), ("schedule", SCHEDULES)
        ):  # fmt: skip
            value = getattr(self, name)
            if value not in known:
                raise ConfigError(f"full_map.{name} is one of {', '.join(known)}, got {value!r}")
        if self.prior_model == "windows" and self.method != "gibbs":
            raise ConfigError(
                "full_map.prior_model windows is for Gibbs sampling, got full_map.method "
                f"{self.method}: set full_map.method gibbs, or leave prior_model at ising"
            )

    def coupling_in(self, ndim: int) -> float:
        """J for cells of a 2D map (2) or a 3D map (3)."""
        if self.coupling is not None:
            return self.coupling
        return 0.8 if ndim == 2 else 0.4

    def prior_in(self, ndim: int) -> float:
        """p(x) of a cell of a 2D map (2) or a 3D map (3)."""
        if self.prior is not None:
            return self.prior
        return 0.475 if ndim == 2 else 0.1

    def log_odds_in(self, ndim: int) -> float:
        """Log odds of a cell that no beam lists, as they are stored: in float32."""
        prior = self.prior_in(ndim)
        return float(np.float32(math.log(prior / (1.0 - prior))))

    def values_in(self, ndim: int) -> dict[str, float]:
        """What is chosen by the dimension where nothing is set, as a map's provenance notes it."""
        return {"prior": self.prior_in(ndim), "coupling": self.coupling_in(ndim)}
