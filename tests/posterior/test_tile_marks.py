# SPDX-License-Identifier: Apache-2.0
"""Marks read tile by tile are those of the states of each cell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import State, Thresholds
from oddsmap.kernels.units import ONE
from oddsmap.query.boxes import Box
from oddsmap.query.obstacles import read_marks


def grid(ndim: int, tile_side: int | None) -> oddsmap.EvidenceMap:
    """Cells with whole votes, fractions, and more votes than a byte holds."""
    made = oddsmap.EvidenceMap(0.1, ndim=ndim, tile_side=tile_side)
    rng = np.random.default_rng(2)
    cells = rng.integers(-40, 40, (3000, ndim)) // [1, 1, 4][:ndim]
    kinds = rng.integers(0, 4, (3000, 2))
    votes = np.choose(kinds, [0, ONE, 3 * ONE, 2])
    votes[::50] += 300 * ONE
    made.add_cells(cells, votes[:, 0], votes[:, 1])
    return made


@pytest.mark.parametrize("tile_side", [None, 5])
@pytest.mark.parametrize("ndim", [2, 3])
def test_every_cell_of_boxes(ndim: int, tile_side: int | None) -> None:
    marks = np.zeros(256, np.uint8)
    for number, state in enumerate(State):
        marks[state % 256] = number + 7
    made = grid(ndim, tile_side)
    prior = oddsmap.EvidenceMap(0.1, ndim=ndim)
    views: list[Any] = [
        made.log_odds(),
        made.log_odds(thresholds=Thresholds(0.4, 0.55)),
        made.log_odds(prior=0.8, clamp=(0.3, 0.9)),
        made.log_odds(prior=prior),
    ]
    rng = np.random.default_rng(3)
    for view in views:
        for _ in range(8):
            lo = rng.integers(-60, 50, ndim)
            box = Box(lo, lo + rng.integers(0, 60, ndim))
            for limits in (None, Thresholds(0.2, 0.9)):
                found = view._state_marks(marks, limits, box)
                state = view.state(box, thresholds=limits)
                assert np.array_equal(found, marks[state.view(np.uint8)])
                assert np.array_equal(found, read_marks(view, box, marks, limits))
    assert set(np.unique(found)) <= set(range(7, 11))
