# SPDX-License-Identifier: Apache-2.0
"""Whether log odds can be trusted on a map, from its counts alone: no scan is held out.

Each vote of a cell is predicted from the cell's other votes: of h hits and p passes a hit from
(h - 1, p), a pass from (h, p - 1), and what log odds make of these is the chance of a hit that a
beam's way through the map is worked out with. All cells with the same counts say the same, so the
map's pairs of counts are enough. It is what held-out scans measure (`scoring.reflection`), as the
mean over all ways to hold one vote of a cell out.

It is no less kind to log odds than other scans would be: votes of beams that went together, from a
pose that was off for a while, stand on both sides. Runs of scans that are held out can find log
odds worse than a constant where this does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.odds import sigmoid
from oddsmap.posterior.count_pairs import CountPairs
from oddsmap.posterior.log_odds import LogOdds

__all__ = ["OwnVotes", "predict_own_votes"]

# As in `scoring.reflection`.
_LEAST = 1e-9
# How many standard errors log odds must be worse by, and on how many cells, before that is said.
_ERRORS = 2.0
_FEWEST = 1000
# Predictions beyond it, and beyond one less it, are sure ones.
_SURE = 0.01


@dataclass(frozen=True, slots=True)
class OwnVotes:
    """How well log odds predict each vote of a map's cells from the others.

    Of fewer than 1,000 cells no verdict is given.

    Args:
        votes: how many were predicted: those of cells with two or more.
        cells: how many such cells there are.
        log_odds: mean -log of the probability that log odds give to what happened [nats].
        constant: the same of one number for all, the share of hits among these votes.
        error: standard error of the difference, cells being independent.
        excess_where_sure: what of the difference comes from votes that log odds predict with
            p below .01 or above .99 [nats per vote].
    """

    votes: float
    cells: float
    log_odds: float
    constant: float
    error: float
    excess_where_sure: float

    @property
    def log_odds_fail(self) -> bool:
        """Whether log odds predict worse than one number, by two standard errors."""
        return self.cells >= _FEWEST and self.log_odds - self.constant > _ERRORS * self.error

    @property
    def too_sure(self) -> bool:
        """Whether that is by what log odds are sure of; else they are still near their prior."""
        return 2.0 * self.excess_where_sure > self.log_odds - self.constant


def predict_own_votes(view: LogOdds, pairs: CountPairs) -> OwnVotes | None:
    """Predict each vote of a map's cells from the others.

    Args:
        view: log odds of the map; a map as the prior is not looked at.
        pairs: the map's counts.

    Returns:
        None where votes are no whole ones (hits that are shared by cells, evidence that fades), or
        no cell has two: nothing can be said.
    """
    h, p, cells = pairs.hits, pairs.passes, pairs.cells
    if not (np.equal(h, np.rint(h)).all() and np.equal(p, np.rint(p)).all()):
        return None
    several = h + p >= 2.0
    h, p, cells = h[several], p[several], cells[several]
    votes, hits = float((cells * (h + p)).sum()), float((cells * h).sum())
    if votes == 0.0:
        return None
    share = min(max(hits / votes, _LEAST), 1.0 - _LEAST)
    # Where a cell has no hit, the first is not asked for: any number will do.
    of_hit = sigmoid(view.of_votes(np.maximum(h - 1.0, 0.0), p))
    of_pass = sigmoid(view.of_votes(h, np.maximum(p - 1.0, 0.0)))
    log_hit, log_pass = math.log(share), math.log1p(-share)
    worse_hit = h * (log_hit - np.log(np.clip(of_hit, _LEAST, 1.0 - _LEAST)))
    worse_pass = p * (log_pass - np.log1p(-np.clip(of_pass, _LEAST, 1.0 - _LEAST)))
    worse = worse_hit + worse_pass
    sure = worse_hit * _is_sure(of_hit) + worse_pass * _is_sure(of_pass)
    constant = -(hits * log_hit + (votes - hits) * log_pass) / votes
    return OwnVotes(
        votes=votes,
        cells=float(cells.sum()),
        log_odds=constant + float((cells * worse).sum()) / votes,
        constant=constant,
        error=math.sqrt(float((cells * worse**2).sum())) / votes,
        excess_where_sure=float((cells * sure).sum()) / votes,
    )


def _is_sure(probability: FloatArray) -> BoolArray:
    return np.asarray((probability < _SURE) | (probability > 1.0 - _SURE))
