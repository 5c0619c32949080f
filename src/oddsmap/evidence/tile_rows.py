# SPDX-License-Identifier: Apache-2.0
"""Tiles as they lie in memory, taken out of a store and added to another.

Nothing is widened: adding bytes to bytes takes an eighth of what units of 64 bits do.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.errors import MapTooLargeError
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import FRACTION_BITS, MAX_UNITS
from oddsmap.kernels.vote.tiles import ANY_FULL, NARROW_MAX, TILE_COUNT, WIDE_COUNT, enter

__all__ = ["TileRows", "add_rows", "rows_of"]


class TileRows(NamedTuple):
    """Some tiles, each at most once: see `oddsmap.kernels.vote.tiles.TileArrays`."""

    coords: IntArray
    """Shape (n, d), x first."""
    load: npt.NDArray[np.uint8]
    """Shape (n,)."""
    narrow: npt.NDArray[np.uint8]
    """Shape (n, 2, cells of a tile)."""
    wide_at: IntArray
    """Which of them have wide counts, shape (m,), ascending."""
    wide: npt.NDArray[np.int64]
    """Shape (m, 2, cells of a tile)."""


def rows_of(tiles: TileStore, slots: IntArray) -> TileRows:
    """Some tiles of a store, copied."""
    arrays = tiles.arrays
    rows = arrays.wide_of[slots]
    wide_at = np.flatnonzero(rows >= 0)
    return TileRows(
        arrays.coords[slots], arrays.load[slots], arrays.narrow[slots], wide_at,
        arrays.wide[rows[wide_at]],
    )  # fmt: skip


def add_rows(tiles: TileStore, rows: TileRows, slots: IntArray) -> None:
    """Add tiles to a store.

    Args:
        tiles: the store.
        rows: the tiles.
        slots: where each of them lies in the store, shape (n,); -1 where it has none, and gets one.

    Raises:
        MapTooLargeError: a cell would pass 2^46 votes, or there is no memory; the store is of no
            use any more.
    """
    _append(tiles, rows.coords, slots)
    full = tiles.arrays.load[slots].astype(np.int64) + rows.load > NARROW_MAX
    needs_wide = full.copy()
    needs_wide[rows.wide_at] = True
    needs_wide &= tiles.arrays.wide_of[slots] < 0
    count = int(np.count_nonzero(needs_wide))
    tiles.reserve(0, count)
    arrays = tiles.arrays
    first = int(arrays.counts[WIDE_COUNT])
    arrays.wide_of[slots[needs_wide]] = np.arange(first, first + count)
    arrays.counts[WIDE_COUNT] += count
    flushed = slots[full]
    if len(flushed):
        arrays.wide[arrays.wide_of[flushed]] += (
            arrays.narrow[flushed].astype(np.int64) << FRACTION_BITS
        )
        arrays.narrow[flushed], arrays.load[flushed] = 0, 0
    arrays.narrow[slots] += rows.narrow
    arrays.load[slots] += rows.load
    if (arrays.load[slots] == NARROW_MAX).any():
        arrays.counts[ANY_FULL] = 1
    if len(rows.wide_at):
        at = arrays.wide_of[slots[rows.wide_at]]
        there = arrays.wide[at]
        if (there > MAX_UNITS - rows.wide).any():
            raise MapTooLargeError(
                "a cell's weight would pass 2^46 votes (2^62 units): "
                "the same evidence has been added many times over"
            )
        arrays.wide[at] = there + rows.wide


def _append(tiles: TileStore, coords: IntArray, slots: IntArray) -> None:
    """Make the tiles that have no slot yet."""
    new = slots < 0
    count, first = int(np.count_nonzero(new)), tiles.count
    tiles.reserve(count, 0)
    arrays = tiles.arrays
    arrays.coords[first : first + count] = coords[new]
    arrays.wide_of[first : first + count] = -1
    arrays.counts[TILE_COUNT] += count
    enter(arrays, first)
    slots[new] = np.arange(first, first + count)
