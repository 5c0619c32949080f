# SPDX-License-Identifier: Apache-2.0
"""Are the probabilities of a map true? Of its cells' next beams, as many should hit as it says.

No truth is needed: scans that the map was not made from are mapped by themselves, in the same way,
and each of their votes in a cell that the map knows is an event, a hit or a pass, which the cell's
probability predicts. Log odds and OctoMap's clamps are meant for another question, whether a cell
is occupied, but are used for this one wherever a beam's way through a map is worked out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.evidence.lookup import units_at
from oddsmap.evidence_map import EvidenceMap
from oddsmap.kernels.units import ONE
from oddsmap.odds import sigmoid
from oddsmap.posterior.count_fit import fit_beta
from oddsmap.posterior.count_pairs import count_pairs
from oddsmap.posterior.log_odds import LogOdds
from oddsmap.scoring.reliability import BINS, Reliability
from oddsmap.short_repr import short_repr

__all__ = [
    "CALIBRATED",
    "CLAMPED",
    "CONSTANT",
    "LOG_ODDS",
    "Predicted",
    "ReflectionScores",
    "clamped",
    "score_predictions",
    "score_reflection",
]

LOG_ODDS, CLAMPED, UNIFORM = "log odds", "OctoMap's clamps", "Beta(1, 1)"
CALIBRATED, CONSTANT = "calibrated", "a constant"

# OctoMap's defaults: p(x | z) of a hit and of a pass, and the limits of probabilities.
_OCTOMAP = (0.7, 0.4, 0.1192, 0.971)
# As in `evaluate`: a prediction that is certain, and wrong, costs this much and no more.
_LEAST = 1e-9
_SURE = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Predicted:
    """How well one way to tell reflectivity predicts votes.

    Args:
        log_loss: mean -log of the probability given to what happened [nats], probabilities clipped
            to [1e-9, 1 - 1e-9].
        reliability: predictions in bins, and what came of them.
        sure_free: of the votes predicted with p < 0.01: mean prediction, share of hits, number.
        sure_hit: of those predicted with p > 0.99: likewise.
    """

    log_loss: float
    reliability: Reliability
    sure_free: tuple[float, float, float]
    sure_hit: tuple[float, float, float]

    @property
    def ece(self) -> float:
        """Expected calibration error, see `Reliability.ece`."""
        return self.reliability.ece


@dataclass(frozen=True, slots=True, eq=False)
class ReflectionScores:
    """How well a map's cells predict whether beams of other scans hit them.

    Args:
        votes: how many events there were [votes].
        unknown: how many more fell in cells that the map does not know [votes].
        of: scores by what predicts: "log odds", "OctoMap's clamps", "Beta(1, 1)", "calibrated" (the
            reflectivity of `EvidenceMap.calibrated`), "a constant" (the share of hits among these
            very events, the best there is).
    """

    votes: float
    unknown: float
    of: dict[str, Predicted]

    __repr__ = short_repr

    @property
    def log_odds_fail(self) -> bool:
        """Whether one number for all cells predicts better than log odds do."""
        return self.of[CONSTANT].log_loss < self.of[LOG_ODDS].log_loss


def score_reflection(grid: EvidenceMap, held_out: EvidenceMap) -> ReflectionScores:
    """Score a map by other scans' hits and passes in the cells that it knows.

    Args:
        grid: the map.
        held_out: a map of scans that it was not made from, of the same resolution, votes and frame.

    Returns:
        The scores.

    Raises:
        InputError: another resolution, dimension or way to vote, or no known cell in common.
    """
    found = predict_reflection(grid, held_out)
    scores = {name: score_predictions(q, found.hits, found.passes) for name, q in found.by.items()}
    return ReflectionScores(float((found.hits + found.passes).sum()), found.unknown, scores)


@dataclass(frozen=True, slots=True, eq=False)
class Predictions:
    """Votes of other scans in the cells that a map knows, and the map's chances of a hit.

    Args:
        hits: weight of hits [votes], shape (n,).
        passes: weight of passes [votes], shape (n,).
        by: the chance of a hit by what predicts it, as in `ReflectionScores.of`, shape (n,) each.
        unknown: how much more fell in cells that the map does not know [votes].
    """

    hits: FloatArray
    passes: FloatArray
    by: dict[str, FloatArray]
    unknown: float


def predict_reflection(grid: EvidenceMap, held_out: EvidenceMap) -> Predictions:
    """What `score_reflection` scores; arguments and errors as there."""
    for what in ("resolution", "ndim", "votes"):
        one, other = getattr(grid, what), getattr(held_out, what)
        if one != other:
            raise InputError(
                f"reflection is scored by a map of the same {what}: the map has {one}, that of "
                f"the other scans {other}"
            )
    index, *theirs = held_out.cells()
    ours = units_at(grid, index)
    known = (ours[0] | ours[1]) > 0
    total = float(sum(units.sum() for units in theirs) / ONE)
    h, p = (units[known] / ONE for units in ours)
    hits, passes = (units[known] / ONE for units in theirs)
    votes = float((hits + passes).sum())
    if votes == 0.0:
        raise InputError(
            "no beam of these scans enters a cell that the map knows: they are of another place, "
            "or of another frame"
        )
    log_odds = grid.log_odds()
    a, b = fit_beta(count_pairs(grid))
    ways = {
        LOG_ODDS: sigmoid(log_odds.of_votes(h, p, log_odds.prior_at(index[known]))),
        CLAMPED: sigmoid(clamped(grid).of_votes(h, p)),
        UNIFORM: (1.0 + h) / (2.0 + h + p),
        CALIBRATED: (a + h) / (a + b + h + p),
        CONSTANT: np.full(len(h), hits.sum() / votes),
    }
    return Predictions(hits, passes, ways, total - votes)


def clamped(grid: EvidenceMap) -> LogOdds:
    """Log odds as OctoMap has them by default, but clamped once and not after each reading."""
    of_hit, of_pass, low, high = _OCTOMAP
    return grid.log_odds(p_hit=of_hit, p_miss=of_pass, prior=0.5, clamp=(low, high))


def score_predictions(q: FloatArray, hit: FloatArray, passed: FloatArray) -> Predicted:
    """Score probabilities of events, each weighing what happened and what did not.

    Args:
        q: the probabilities, shape (n,).
        hit: how often it happened, shape (n,).
        passed: how often it did not, shape (n,).
    """
    n = hit + passed
    clipped = np.clip(q, _LEAST, 1.0 - _LEAST)
    loss = -(hit * np.log(clipped) + passed * np.log1p(-clipped)).sum() / n.sum()
    place = np.minimum((q * BINS).astype(np.int64), BINS - 1)
    count, predicted, happened = (np.bincount(place, x, BINS) for x in (n, q * n, hit))
    return Predicted(
        float(loss),
        Reliability(count, predicted, happened),  # type: ignore[arg-type]  # weights, not numbers
        _those(q < _SURE, q, hit, n),
        _those(q > 1.0 - _SURE, q, hit, n),
    )


def _those(
    chosen: npt.NDArray[np.bool_], q: FloatArray, hit: FloatArray, n: FloatArray
) -> tuple[float, float, float]:
    total = float(n[chosen].sum())
    if total == 0.0:
        return np.nan, np.nan, 0.0
    return float((q * n)[chosen].sum()) / total, float(hit[chosen].sum()) / total, total
