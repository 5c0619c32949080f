# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest

from oddsmap import ProbabilityMap, State, Thresholds
from oddsmap.errors import ConfigError, InputError


def test_state() -> None:
    p = np.array([[0.0, 0.196, 0.1961], [0.5, 0.6499, 0.65], [0.5, 0.0, 1.0]])
    observed = np.array([[True] * 3, [True] * 3, [False] * 3])
    want = [
        [State.FREE, State.FREE, State.UNDECIDED],
        [State.UNDECIDED, State.UNDECIDED, State.OCCUPIED],
        [State.UNKNOWN] * 3,
    ]
    grid = ProbabilityMap(p, observed, 0.1)
    assert grid.state().tolist() == want
    assert grid.state().dtype == np.int8
    wide = grid.state(thresholds=Thresholds(0.0, 1.0))
    assert wide.tolist() == [[0, 50, 50], [50, 50, 50], [-1, -1, -1]]


@pytest.mark.parametrize(
    ("free", "occupied"),
    [(0.5, 0.5), (0.7, 0.3), (-0.1, 0.5), (0.1, 1.1), (math.nan, 0.5), (0.1, math.nan)],
)
def test_thresholds_that_make_no_sense(free: float, occupied: float) -> None:
    with pytest.raises(ConfigError, match="0 <= free < occupied <= 1"):
        Thresholds(free, occupied)


def test_shapes() -> None:
    with pytest.raises(InputError, match="two arrays of one shape"):
        ProbabilityMap(np.zeros((2, 3)), np.zeros((3, 2), np.bool_), 0.1)
    with pytest.raises(InputError, match="two arrays of one shape"):
        ProbabilityMap(np.zeros(3), np.zeros(3, np.bool_), 0.1)


@pytest.mark.parametrize("resolution", [0.0, -1.0, math.nan, math.inf])
def test_resolution(resolution: float) -> None:
    with pytest.raises(InputError, match="positive resolution"):
        ProbabilityMap(np.zeros((1, 1)), np.zeros((1, 1), np.bool_), resolution)
