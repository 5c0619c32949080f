# SPDX-License-Identifier: Apache-2.0
"""Where tiles have changed: every change is seen, and little else."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from oddsmap.array_types import IntArray
from oddsmap.evidence.tile_watch import TileWatch
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import ONE


def changed(watch: TileWatch, tiles: TileStore) -> list[list[int]]:
    found = watch.changed(tiles)
    assert found is not None
    return [np.asarray(end).tolist() for end in found]


def add(tiles: TileStore, cells: Any, units: int) -> None:
    index: IntArray = np.array(cells, np.int64)
    tiles.add_cells(index, np.full((len(index), 2), units))


@pytest.mark.parametrize("side", [3, 8])
def test_each_kind_of_change(side: int) -> None:
    tiles = TileStore(2, side)
    add(tiles, [[0, 0], [100, 50], [-30, 7]], ONE)
    watch = TileWatch(tiles, None)
    nothing = [[0, 0], [0, 0]]
    assert changed(watch, tiles) == nothing
    # Whole votes, a fraction of one, more of it, more than 255, and a tile that is new.
    for units in (ONE, 1, 1, 300 * ONE):
        add(tiles, [[100, 50]], units)
        first = [100 // side * side, 50 // side * side]
        assert changed(watch, tiles) == [first, [n + side for n in first]]
        assert changed(watch, tiles) == nothing
    add(tiles, [[500, -500]], ONE)
    add(tiles, [[0, 0]], ONE)
    first = [0, -500 // side * side]
    assert changed(watch, tiles) == [first, [500 // side * side + side, side]]
    assert changed(watch, tiles) == nothing


def test_only_a_box_is_watched() -> None:
    tiles = TileStore(3, 8)
    add(tiles, [[0, 0, 0], [40, 0, 0]], ONE)
    watch = TileWatch(tiles, (np.array([0, 0, 0]), np.array([9, 9, 9])))
    add(tiles, [[40, 0, 0], [80, 0, 0], [9, 9, 20]], ONE)
    assert changed(watch, tiles) == [[0, 0, 0], [0, 0, 0]]
    add(tiles, [[9, 9, 9]], ONE)
    assert changed(watch, tiles) == [[8, 8, 8], [16, 16, 16]]
    add(tiles, [[1, 1, 1]], 1)
    assert changed(watch, tiles) == [[0, 0, 0], [8, 8, 8]]


def test_another_store_and_one_that_was_emptied() -> None:
    tiles = TileStore(2, 8)
    add(tiles, [[0, 0], [50, 0]], ONE)
    watch = TileWatch(tiles, None)
    other = TileStore(2, 8)
    other.merge(tiles)
    assert watch.changed(other) is None
    tiles.clear()
    assert watch.changed(tiles) is None
    add(tiles, [[50, 0]], ONE)
    add(tiles, [[0, 0]], ONE)
    assert watch.changed(tiles) is None  # the same tiles in another order
    empty = TileStore(2, 8)
    watch = TileWatch(empty, None)
    add(empty, [[1, 1]], ONE)
    assert changed(watch, empty) == [[0, 0], [8, 8]]
