# SPDX-License-Identifier: Apache-2.0
"""Occupancy by a map that is taken for the truth, against a loop over cells."""

from __future__ import annotations

import math

import numpy as np
import pytest

from oddsmap import EvidenceMap, InputError
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.scoring.occupancy import score_occupancy
from oddsmap.scoring.truth import evaluate

CELL = 0.5


def some_map(ndim: int = 2) -> EvidenceMap:
    rng, grid = np.random.default_rng(3), EvidenceMap(CELL, ndim=ndim)
    index = np.unique(rng.integers(-2, 7, (60, ndim)), axis=0)
    hits = rng.integers(0, 4, len(index))
    grid.add_cells(index, hits << 16, (6 - hits) << 16)
    return grid


def test_against_a_loop() -> None:
    """The truth has cells half as large; a cell's truth is that of the one at its centre."""
    rng, grid = np.random.default_rng(4), some_map()
    p = rng.choice([0.0, 0.4, 1.0], (16, 14))
    seen = rng.random(p.shape) < 0.7
    truth = ProbabilityMap(p, seen, CELL / 2, (-1.0, -1.0))
    view = grid.log_odds()
    found = score_occupancy(view, truth)
    told, true = [], []
    for x, y in grid.cells()[0].tolist():
        column, row = (math.floor(((i + 0.5) * CELL + 1.0) / (CELL / 2)) for i in (x, y))
        if 0 <= row < 16 and 0 <= column < 14 and seen[row, column] and p[row, column] != 0.4:
            told.append(float(view.at([[(x + 0.5) * CELL, (y + 0.5) * CELL]])[0]))
            true.append(p[row, column] == 1.0)
    expected = evaluate(told, true)
    assert (found.cells, found.occupied) == (len(true), sum(true))
    assert found.cells + found.without_truth == grid.cell_count()
    assert found.of["log odds"].log_loss == pytest.approx(expected.log_loss)
    assert found.of["log odds"].ece == pytest.approx(expected.ece)
    assert found.iou["log odds"] == pytest.approx(expected.iou)
    share = np.mean(true)
    entropy = -share * math.log(share) - (1 - share) * math.log(1 - share)
    assert found.of["a constant"].log_loss == pytest.approx(entropy)


def test_what_does_not_go_together() -> None:
    view = some_map().log_odds()
    with pytest.raises(InputError, match="the truth is 3D, and the map is 2D"):
        score_occupancy(view, some_map(3).log_odds())
    far = ProbabilityMap(np.ones((2, 2)), np.ones((2, 2), np.bool_), CELL, (900.0, 0.0))
    with pytest.raises(InputError, match="knows no cell that the map knows"):
        score_occupancy(view, far)
