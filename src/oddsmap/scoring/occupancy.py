# SPDX-License-Identifier: Apache-2.0
"""Is something there? A map's known cells against a map that is taken for the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.evidence_map import EvidenceMap
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.maps.voxel_map import VoxelMap
from oddsmap.odds import State, sigmoid
from oddsmap.posterior.belief import Belief
from oddsmap.posterior.count_view import CountView
from oddsmap.scoring.reflection import (
    CALIBRATED,
    CLAMPED,
    CONSTANT,
    LOG_ODDS,
    Predicted,
    clamped,
    score_predictions,
)
from oddsmap.scoring.truth import evaluate

__all__ = ["FULL_MAP", "OccupancyScores", "score_occupancy"]

FULL_MAP = "full map"


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyScores:
    """How well p(occupied) of a map's known cells fits the truth.

    Args:
        cells: how many were scored.
        occupied: how many of them are occupied.
        without_truth: known cells more that the truth says nothing of.
        of: scores by what gives p(occupied): "log odds", "OctoMap's clamps" and "calibrated", or
            "full map"; "a constant" is the share of occupied cells.
        iou: intersection over union of the occupied cells, by the same names; NaN where there is
            none in either.
    """

    cells: int
    occupied: int
    without_truth: int
    of: dict[str, Predicted]
    iou: dict[str, float]


def score_occupancy(belief: Belief, truth: Belief | VoxelMap | ProbabilityMap) -> OccupancyScores:
    """Score the cells that a map knows by a map that is taken for the truth.

    A cell's truth is what the other map says at its centre: free or occupied, by that map's
    thresholds. What is unknown or undecided there is not scored.

    Args:
        belief: the map: a view of counts, or a full map.
        truth: the other map, of the same frame and dimension, of any resolution.

    Raises:
        InputError: another dimension, or the truth knows none of the map's cells.
    """
    if truth.ndim != belief.ndim:
        raise InputError(f"the truth is {truth.ndim}D, and the map is {belief.ndim}D")
    index, log_odds = belief.known_log_odds()
    state = truth.states_at((index + 0.5) * belief.resolution).state
    decided = (state == State.FREE) | (state == State.OCCUPIED)
    occupied = state[decided] == State.OCCUPIED
    if len(occupied) == 0:
        raise InputError(
            "the truth knows no cell that the map knows: they are of different frames, or places"
        )
    ways: dict[str, FloatArray] = {}
    if isinstance(belief, CountView) and isinstance(belief.evidence, EvidenceMap):
        grid = belief.evidence
        ways = {
            LOG_ODDS: grid.log_odds().log_odds_at(index[decided]),
            CLAMPED: clamped(grid).log_odds_at(index[decided]),
            CALIBRATED: grid.calibrated().log_odds_at(index[decided]),
        }
    else:
        ways = {FULL_MAP: log_odds[decided]}
    chances = {name: np.asarray(sigmoid(way)) for name, way in ways.items()}
    chances[CONSTANT] = np.full(len(occupied), occupied.mean())
    hit = occupied.astype(np.float64)
    return OccupancyScores(
        cells=len(occupied),
        occupied=int(occupied.sum()),
        without_truth=int((~decided).sum()),
        of={name: score_predictions(p, hit, 1.0 - hit) for name, p in chances.items()},
        iou={name: evaluate(p, occupied).iou for name, p in chances.items()},
    )
