# SPDX-License-Identifier: Apache-2.0
"""Cells in the order of an octree, some at a time, against a sort by interleaved bits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.evidence.octree_order import has_octree_order, octree_parts
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import ONE

BASE = -(1 << 15)
PLACES = st.integers(-20, 20) | st.sampled_from([BASE, -BASE - 1, 4096, -4097])
WEIGHTS = st.sampled_from([0, ONE, 255 * ONE, 300 * ONE, 7])


def interleaved(cell: tuple[int, ...]) -> int:
    """The Morton code bit by bit."""
    code = 0
    for bit in range(16):
        for axis in range(3):
            code |= ((cell[axis] - BASE) >> bit & 1) << (3 * bit + axis)
    return code


@settings(max_examples=60)
@given(
    st.dictionaries(st.tuples(PLACES, PLACES, PLACES), st.tuples(WEIGHTS, WEIGHTS), max_size=40),
    st.sampled_from([1, 2, 8]),
    st.sampled_from([1, 5, 1 << 16]),
)
def test_against_a_sort(
    cells: dict[tuple[int, int, int], tuple[int, int]], side: int, most: int
) -> None:
    tiles = TileStore(3, side)
    index, units = np.array([*cells]), np.array([*cells.values()])
    tiles.add_cells(index.reshape(-1, 3), units.reshape(-1, 2))
    expected = sorted((interleaved(cell), *both) for cell, both in cells.items() if any(both))
    found = []
    for part in octree_parts(tiles, np.full(3, BASE), most):
        assert 0 < len(part[0]) <= most + side**3
        found += list(zip(*(array.tolist() for array in part), strict=True))
    assert found == expected


@pytest.mark.parametrize(("side", "fits"), [(1, True), (8, True), (6, False), (3, False)])
def test_which_tiles_are_nodes(side: int, fits: bool) -> None:
    assert has_octree_order(TileStore(3, side), np.full(3, BASE)) == fits
    assert not has_octree_order(TileStore(2, side), np.full(2, BASE))
    assert has_octree_order(TileStore(3, side), np.full(3, BASE + 1)) == (side == 1)
