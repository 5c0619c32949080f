# SPDX-License-Identifier: Apache-2.0
"""Squared distances of one box to the marks of another, against every pair of cells."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.kernels.query.distances import FAR
from oddsmap.query.boxes import Box
from oddsmap.query.squared_distances import none_of, squared_to
from tests.naive.distances import cells_of, nearest_squared


@st.composite
def questions(draw: st.DrawFn) -> tuple[Any, Box, Box, int | None]:
    """A mask, its box, another box near it, inside it, around it or beside it, and a reach."""
    d = draw(st.sampled_from([2, 3]))
    side = st.integers(1, 9 if d == 2 else 5)
    sides = np.array([draw(side) for _ in range(d)])
    lo = np.array([draw(st.integers(-4, 4)) for _ in range(d)])
    read = Box(lo, lo + sides)
    if draw(st.booleans()):
        box = read
    else:
        first = lo + [draw(st.integers(-7, 7)) for _ in range(d)]
        box = Box(first, first + [draw(st.integers(0, 6)) for _ in range(d)])
    share = draw(st.sampled_from([0.0, 0.05, 0.3, 0.9, 1.0]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    mask = (rng.random(read.shape) < share).astype(np.uint8)
    reach = draw(st.sampled_from([None, 0, 1, 2, 5, 9, 30]))
    return mask, read, box, reach


def check(mask: Any, read: Box, box: Box, reach: int | None, dtype: Any, threads: int = 1) -> None:
    found = squared_to(mask, read, box, reach, dtype, threads)
    none = none_of(dtype)
    least = nearest_squared(cells_of(*box), np.argwhere(mask)[:, ::-1] + read.lo, reach)
    want = [none if squared is None else squared for squared in least]
    assert found.dtype == dtype
    assert found.shape == box.shape
    assert found.ravel().tolist() == want


@given(questions(), st.sampled_from([np.int32, np.int64]), st.sampled_from([1, 2]))
def test_every_pair(asked: Any, dtype: Any, threads: int) -> None:
    mask, read, box, reach = asked
    check(mask, read, box, reach, dtype, threads)


def test_strips_of_columns_and_borders_of_strips() -> None:
    rng = np.random.default_rng(3)
    for nx in (15, 16, 17, 33):
        mask = (rng.random((3, 4, nx)) < 0.05).astype(np.uint8)
        read = Box(np.array([5, -2, 0]), np.array([5 + nx, 2, 3]))
        check(mask, read, read, None, np.int32, 2)
        check(mask, read, read.wider(1), 40, np.int32)


@pytest.mark.parametrize("d", [2, 3])
def test_boxes_far_apart_need_large_numbers(d: int) -> None:
    """Squares near 2^60: quotients that doubles would not round down as whole numbers do."""
    rng = np.random.default_rng(1)
    read = Box(np.zeros(d, np.int64), np.full(d, 7))
    mask = (rng.random(read.shape) < 0.3).astype(np.uint8)
    for far in (1 << 15, 1 << 28, FAR - 20):
        for shift in np.ndindex(*(3,) * d):
            lo = (np.array(shift) - 1) * far
            check(mask, read, Box(lo, lo + 4), None, np.int64)


def test_a_long_line_of_ties() -> None:
    mask = np.zeros((1, 4001), np.uint8)
    mask[0, ::1000] = 1
    read = Box(np.array([0, 0]), np.array([4001, 1]))
    found = squared_to(mask, read, read, None, np.int32, 1)[0]
    at = np.arange(4001)
    assert np.array_equal(found, np.minimum(at % 1000, -at % 1000) ** 2)
