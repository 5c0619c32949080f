# SPDX-License-Identifier: Apache-2.0
"""What a map's cells are like: how often they reflect a beam, and which of them are occupied.

A cell's beams are not independent: poses are off, a surface is at a border of cells, a person
stands in the way. So each cell has a reflectivity r of its own, and its hits h and passes p have
the probability r^h (1 - r)^p. How r is distributed among the cells is the map's, and is fitted to
its counts (`count_fit`): any distribution, on a grid of values. It differs with the number of
beams that entered a cell: where few did, many of the cells are the insides of walls, which only
beams of a wrong pose or a wrong range reach.

Whether a cell of reflectivity r is occupied is the same for all maps: hardly ever below a tenth,
nearly always above a half. Of simulated worlds whose truth is known this is the logistic function
of logit(r) that `occupied_at` has. So however many beams enter a cell, they say no more than r
does, and evidence saturates by itself:

    p(occupied | h, p) = sum_r f_n(r) r^h (1 - r)^p occupied_at(r) / sum_r f_n(r) r^h (1 - r)^p.

Source: Laird, Nonparametric maximum likelihood estimation of a mixing distribution, J. Am. Stat.
Assoc. 73 (1978), for distributions on a grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.short_repr import described

__all__ = ["KNOTS", "LOG_MISS", "LOG_REFLECT", "CountModel", "knots_of", "occupied_at"]

# Evenly spaced in logit(r): 48 values, which leaves gaps of a third.
_LOGIT = np.linspace(-9.2, 5.3, 48)
LOG_REFLECT: FloatArray = -np.logaddexp(0.0, -_LOGIT)
"""log r of the values that a reflectivity may have, ascending, shape (48,)."""
LOG_MISS: FloatArray = -np.logaddexp(0.0, _LOGIT)
"""log (1 - r) of the same, shape (48,)."""

KNOTS = 8
"""How many distributions there are: of cells of 0, 1, 3, 7, ... 127 beams or more. Between them
they are mixed in proportion to log(1 + beams)."""

# Half of the cells of this reflectivity are occupied; how fast that changes with its logit; and
# what is never surer than this, as a share of cells.
_HALF, _STEEPNESS, _LEAST = 0.27, 4.0, 3e-4


@dataclass(frozen=True, slots=True)
class CountModel:
    """How reflectivities are distributed among the cells of a map.

    Args:
        distributions: for each of `KNOTS` numbers of beams the share of cells that have each
            reflectivity of the grid; the first, of none, is that of all known cells.
    """

    distributions: tuple[tuple[float, ...], ...]

    def __repr__(self) -> str:
        return described(self, lambda: [f"{self.occupied_share:.4g} of known cells occupied"])

    @property
    def occupied_share(self) -> float:
        """Share of occupied cells: p(occupied) of a known cell before its counts are looked at."""
        return float((np.array(self.distributions[0]) * occupied_at()).sum())

    @property
    def prior_log_odds(self) -> float:
        """Log odds of `occupied_share`."""
        share = self.occupied_share
        return float(np.log(share) - np.log1p(-share))

    def log_bayes_factor(self, hits: npt.ArrayLike, passes: npt.ArrayLike) -> FloatArray:
        """How much more counts speak for an occupied cell than for one that is not [nats].

        Args:
            hits: weights [votes], any shape.
            passes: weights, of the same shape.

        Returns:
            log p(hits, passes | occupied) - log p(hits, passes | not), exactly 0 for no evidence.
        """
        return self.log_odds(hits, passes) - self.prior_log_odds

    def log_odds(self, hits: npt.ArrayLike, passes: npt.ArrayLike) -> FloatArray:
        """Log odds of an occupied cell under the fitted share; arguments as `log_bayes_factor`."""
        h, p = np.broadcast_arrays(np.asarray(hits, np.float64), np.asarray(passes, np.float64))
        factor, seen = np.full(h.shape, self.prior_log_odds), (h > 0.0) | (p > 0.0)
        if seen.any():
            # Each pair of counts once: there are a hundred times fewer than cells.
            some, back = np.unique(h[seen] + 1j * p[seen], return_inverse=True)
            factor[seen] = self._of_pairs(some.real, some.imag)[back]
        return factor

    def _of_pairs(self, h: FloatArray, p: FloatArray) -> FloatArray:
        tables, occupied = np.array(self.distributions), occupied_at()
        below, share = knots_of(h + p)
        best = np.full(len(h), -np.inf)
        for log_r, log_q in zip(LOG_REFLECT, LOG_MISS, strict=True):
            np.maximum(best, h * log_r + p * log_q, out=best)
        yes, no = np.zeros(len(h)), np.zeros(len(h))
        for j, (log_r, log_q) in enumerate(zip(LOG_REFLECT, LOG_MISS, strict=True)):
            prior = (1.0 - share) * tables[below, j] + share * tables[below + 1, j]
            joint = prior * np.exp(h * log_r + p * log_q - best)
            yes += occupied[j] * joint
            no += (1.0 - occupied[j]) * joint
        return np.asarray(np.log(yes) - np.log(no))


def occupied_at() -> FloatArray:
    """Share of occupied cells among those of each reflectivity of the grid, shape (48,)."""
    half = np.log(_HALF) - np.log1p(-_HALF)
    curve = 1.0 / (1.0 + np.exp(-_STEEPNESS * (_LOGIT - half)))
    return np.asarray(_LEAST + (1.0 - 2.0 * _LEAST) * curve)


def knots_of(beams: FloatArray) -> tuple[IntArray, FloatArray]:
    """Which two distributions cells of given numbers of beams have.

    Args:
        beams: weights of hits and passes together [votes], shape (n,).

    Returns:
        The first of the two, and the share of the second, shape (n,) each.
    """
    place = np.minimum(np.log2(1.0 + beams), KNOTS - 1)
    below = np.minimum(place.astype(np.int64), KNOTS - 2)
    return below, place - below
