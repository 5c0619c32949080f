# SPDX-License-Identifier: Apache-2.0
"""The table of votes, against the function itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.array_types import FloatArray
from oddsmap.kernels.units import ONE
from oddsmap.posterior.vote_table import VoteTable

# Whole votes on both sides of what the table holds, parts of one, and the most there may be.
WEIGHTS = st.sampled_from([0, 0, 1, ONE - 1, ONE, 3 * ONE, 255 * ONE, 256 * ONE, 1 << 61])


def share(hits: FloatArray, passes: FloatArray) -> FloatArray:
    return np.log1p(hits) - 0.3 * passes


@given(st.lists(st.lists(st.tuples(WEIGHTS, WEIGHTS), max_size=8), max_size=4))
def test_the_same_bits(parts: list[list[tuple[int, int]]]) -> None:
    table = VoteTable(share)
    for part in parts:
        hits, passes = np.array(part, np.int64).reshape(-1, 2).T
        expected = [share(h / ONE, p / ONE) for h, p in zip(hits, passes, strict=True)]
        assert table(hits, passes).tolist() == expected


def test_each_pair_once_and_the_type_of_the_function() -> None:
    asked: list[tuple[float, float]] = []

    def sign(hits: FloatArray, passes: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.int8]]:
        asked.extend(zip(hits.tolist(), passes.tolist(), strict=True))
        return np.sign(hits - passes).astype(np.int8)

    table = VoteTable(sign)
    asked.clear()
    hits = np.array([2, 0, 2, 5]) * ONE
    for _ in range(2):
        found = table(hits, np.array([1, 1, 1, 9]) * ONE)
        assert found.dtype == np.int8
        assert found.tolist() == [1, -1, 1, -1]
    assert sorted(asked) == [(0.0, 1.0), (2.0, 1.0), (5.0, 9.0)]


@pytest.mark.parametrize("weight", [0, ONE, 300 * ONE])
def test_nothing_asked(weight: int) -> None:
    table = VoteTable(share)
    table(np.array([weight]), np.array([weight]))
    assert table(np.zeros(0, np.int64), np.zeros(0, np.int64)).tolist() == []
