# SPDX-License-Identifier: Apache-2.0
"""Kinds of cells, each with its own distribution of hits among the beams that enter a cell.

Beams that enter one cell are not independent: poses are off for seconds, a surface is at a border
of cells, a person stands in the way of a hundred scans. So the counts of a kind of cells are
overdispersed: each cell has a reflectivity of its own, drawn from the Beta distribution of its
kind, and its hits h and passes p are beta-binomial,

    p(h, p | kind) = B(a + h, b + p) / B(a, b).

However many beams agree, they then say no more of the kind than the reflectivity that they are
counted from: evidence saturates by itself. There are three kinds: free cells, free cells beside
something, which noise and grazing beams hit now and then, and occupied cells.

Source: Skellam, A probability distribution derived from the binomial distribution by regarding the
probability of success as variable between the sets of trials, J. R. Stat. Soc. B 10 (1948).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray

__all__ = ["CellClasses", "log_beta_binomial"]


@dataclass(frozen=True, slots=True)
class CellClasses:
    """The kinds of cells of a map: free, free beside something, occupied, in this order.

    Args:
        mean: mean reflectivity of each kind, between 0 and 1.
        concentration: a + b of each kind [votes]: the larger, the more alike its cells are.
        share: of each kind among the known cells; they add up to 1.
    """

    mean: tuple[float, float, float]
    concentration: tuple[float, float, float]
    share: tuple[float, float, float]

    @property
    def occupied_share(self) -> float:
        """Share of occupied cells: p(occupied) of a known cell before its counts are looked at."""
        return self.share[2]

    def log_bayes_factor(self, hits: npt.ArrayLike, passes: npt.ArrayLike) -> FloatArray:
        """How much more counts speak for an occupied cell than for one that is not [nats].

        Args:
            hits: weights [votes], any shape.
            passes: weights, of the same shape.

        Returns:
            log p(hits, passes | occupied) - log p(hits, passes | not), exactly 0 for no evidence.
        """
        h, p = np.asarray(hits, np.float64), np.asarray(passes, np.float64)
        free, beside, occupied = (
            log_beta_binomial(h, p, mean * total, (1.0 - mean) * total)
            for mean, total in zip(self.mean, self.concentration, strict=True)
        )
        log_free, log_beside = np.log(self.share[:2]) - np.log(sum(self.share[:2]))
        factor = occupied - np.logaddexp(log_free + free, log_beside + beside)
        return np.where((h == 0.0) & (p == 0.0), 0.0, factor)


def log_beta_binomial(
    hits: FloatArray, passes: FloatArray, alpha: float, beta: float
) -> FloatArray:
    """Log probability of counts in one order, log B(alpha + hits, beta + passes) / B(alpha, beta).

    How many orders there are is the same for every kind of cell.
    """
    from scipy.special import gammaln

    total = alpha + beta
    log_p = gammaln(alpha + hits) + gammaln(beta + passes) - gammaln(total + hits + passes)
    return np.asarray(log_p - (gammaln(alpha) + gammaln(beta) - gammaln(total)))
