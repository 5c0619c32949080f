# SPDX-License-Identifier: Apache-2.0
"""Numbers of cells in blocks, against cells taken apart one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.kernels.infer.block_numbering import find_blocks, number_cells

Cell = tuple[int, ...]


@given(st.data(), st.sampled_from([2, 3]), st.sampled_from([1, 3, 8]))
def test_against_one_cell_at_a_time(data: st.DataObject, d: int, side: int) -> None:
    blocks = data.draw(st.tuples(*[st.integers(1, 4)] * d))
    known = data.draw(st.integers(0, 3))
    shape = np.array(blocks, np.int64) * side
    cells: list[Cell] = data.draw(
        st.lists(st.tuples(*(st.integers(0, int(n) - 1) for n in shape)), max_size=20)
    )
    spans = np.concatenate([[1], np.cumprod(shape[:-1])])
    dtype = data.draw(st.sampled_from([np.int32, np.int64]))
    places = np.array([int(np.dot(cell, spans)) for cell in cells], dtype)
    strides = np.concatenate([[1], np.cumprod(blocks[:-1])]).astype(np.int64)
    table = np.full(int(np.prod(blocks)), -1, np.int32)
    table[:known] = np.arange(100, 100 + len(table[:known]))
    before = table.copy()

    homes = [int(np.dot([x // side for x in cell], strides)) for cell in cells]
    fresh = list(dict.fromkeys(home for home in homes if before[home] == -1))
    found = np.empty(len(table), np.int64)
    count = find_blocks(places, shape, side, strides, table, found)
    assert found[:count].tolist() == fresh
    # What is listed once is not listed again, and what was known keeps its number.
    assert [at for at in range(len(table)) if table[at] != before[at]] == sorted(fresh)
    assert find_blocks(places, shape, side, strides, table, found) == 0

    table[fresh] = np.arange(len(fresh))
    numbers = np.empty(len(places), np.int32)
    number_cells(places, shape, side, strides, table, numbers)
    for cell, home, number in zip(cells, homes, numbers, strict=True):
        within = sum((x % side) * side**axis for axis, x in enumerate(cell))
        assert number == table[home] * side**d + within


def test_places_beyond_31_bits() -> None:
    """A window may have more cells than an int32 can count."""
    side, blocks = 32, np.array([4096, 4096], np.int64)
    shape = blocks * side
    table = np.full(int(blocks.prod()), -1, np.int32)
    place = np.array([int(shape.prod()) - 1], np.int64)
    assert place[0] > 2**33
    found = np.empty(1, np.int64)
    arguments = (place, shape, side, np.array([1, 4096]), table)
    assert find_blocks(*arguments, found) == 1
    assert found[0] == len(table) - 1
    table[found] = 7
    numbers = np.empty(1, np.int32)
    number_cells(*arguments, numbers)
    assert numbers[0] == 8 * side**2 - 1


@pytest.mark.parametrize("d", [2, 3])
def test_no_cells(d: int) -> None:
    shape, table = np.full(d, 8, np.int64), np.full(1, -1, np.int32)
    found, numbers = np.empty(1, np.int64), np.empty(0, np.int32)
    none = np.empty(0, np.int64)
    assert find_blocks(none, shape, 8, np.ones(d, np.int64), table, found) == 0
    number_cells(none, shape, 8, np.ones(d, np.int64), table, numbers)
    assert table[0] == -1
