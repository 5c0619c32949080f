# SPDX-License-Identifier: Apache-2.0
"""The numbered cells of full-map estimation, against plain dictionaries."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.errors import MapTooLargeError
from oddsmap.forward import cell_grid as module
from oddsmap.forward.cell_grid import CellField, Window
from tests.full_map.kit import beam, estimated

START = -1234
Block = tuple[int, ...]


def blocks_of(d: int) -> st.SearchStrategy[list[list[Block]]]:
    """Batches of blocks, near each other and far from the origin, some of them again and again."""
    near = st.tuples(*[st.integers(-2, 2)] * d)
    far = st.tuples(*[st.integers(-(10**9), 10**9)] * d)
    return st.lists(st.lists(st.one_of(near, far), max_size=8), max_size=6)


@given(st.sampled_from([2, 3]), st.data())
def test_numbers_and_sides(d: int, data: st.DataObject) -> None:
    field = CellField(d, START)
    numbers: dict[Block, int] = {}
    marked: dict[int, int] = {}
    for i, batch in enumerate(data.draw(blocks_of(d))):
        coords = np.array(batch, np.int64).reshape(-1, d)
        got = field.insert(coords)
        for block in batch:
            numbers.setdefault(block, len(numbers))
        assert got.tolist() == [numbers[block] for block in batch]
        # Growing moves nothing that has been written.
        for number in got.tolist():
            field.belief[number * field.block_cells + i] = marked[number] = i
    count = len(numbers)
    assert field.coords.tolist() == [list(block) for block in numbers]
    assert field.belief.shape == field.observed.shape == (count * field.block_cells,)
    assert field.received.shape == (count * field.block_cells, 2 * d)
    assert not field.received.any()
    assert not field.observed.any()
    rows = field.belief.reshape(count, field.block_cells)
    for number, i in marked.items():
        assert rows[number, i] == i
    assert np.count_nonzero(rows != START) >= count
    for block, number in numbers.items():
        for axis in range(d):
            for up in (0, 1):
                other = tuple(x + (2 * up - 1 if a == axis else 0) for a, x in enumerate(block))
                assert field.block_neighbours()[number, 2 * axis + up] == numbers.get(other, -1)
                assert field.find(np.array([other])) == [numbers.get(other, -1)]


@given(st.sampled_from([2, 3]), st.data())
def test_a_cell_gets_its_number_back(d: int, data: st.DataObject) -> None:
    """Cells near and far, negative ones too: cell -> place in a window -> number -> cell."""
    side = CellField(d, 0).side
    corner = data.draw(st.tuples(*[st.integers(-(10**8), 10**8)] * d))
    lo = np.array(corner, np.int64)
    extent = data.draw(st.tuples(*[st.integers(1, 70)] * d))
    cells = data.draw(
        st.lists(st.tuples(*(st.integers(0, n - 1) for n in extent)), min_size=1, max_size=30)
    )
    field = CellField(d, 0)
    for part in (cells, cells[::-1]):  # a second window over the same blocks gives the same numbers
        window = Window(field, lo, lo + extent)
        assert (window.lo <= lo).all()
        assert (window.lo + window.shape >= lo + extent).all()
        assert not (window.lo % side).any()
        index = lo + np.array(part, np.int64)
        spans = np.concatenate([[1], np.cumprod(window.shape[:-1])])
        numbers = window.number((index - window.lo) @ spans)
        np.testing.assert_array_equal(field.index(numbers), index)
        assert len(field.coords) == len({tuple(cell) for cell in (index // side).tolist()})


def test_a_window_that_is_too_large_is_refused() -> None:
    field = CellField(2, 0)
    with pytest.raises(MapTooLargeError, match="the beams span 1600000032 x 1600000032 cells"):
        Window(field, np.zeros(2, np.int64), np.full(2, 1_600_000_001))
    assert len(field.coords) == 0


def test_too_many_cells_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MAX_CELLS", 2 * 1024)
    field = CellField(2, 0)
    field.insert(np.array([[0, 0], [5, 5]]))
    with pytest.raises(MapTooLargeError, match=r"up to 2\^31 cells.*coarser resolution"):
        field.insert(np.array([[1, 0]]))


def test_memory_is_of_the_cells_that_beams_reach() -> None:
    """Two places 3 km apart: twice the blocks of one, not the square kilometres between."""
    here = [beam(0.05, 0.05, 0.3 * i, 1.0 + 0.1 * i) for i in range(12)]
    there = [beam(3200.05, -3199.95, 0.3 * i, 1.0 + 0.1 * i) for i in range(12)]
    one, two = estimated(here), estimated([*here, *there])
    assert len(two.blocks) == 2 * len(one.blocks) < 20
    assert two.nbytes == 2 * one.nbytes
    assert two.cell_count == 2 * one.cell_count
