# SPDX-License-Identifier: Apache-2.0
"""Tiles from a square or a cube of counts, as they are stored on disk."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.units import FRACTION_BITS, HITS, PASSES
from oddsmap.kernels.vote.tiles import (
    ANY_FULL,
    NARROW_MAX,
    TileArrays,
    find_or_insert,
    wide_row,
)

__all__ = ["fill_tiles", "tiles_in"]

IntArray = npt.NDArray[np.int64]
Counts = npt.NDArray[np.unsignedinteger]


@borrowing
def tiles_in(counts: Counts, width: int, side: int, in_space: bool, most: IntArray) -> None:
    """Find the largest count in each tile of a box, 0 where it is empty.

    Args:
        counts: hits and passes, none beyond int64, shape (2, width^d), x fastest.
        width: cells along the sides of the box, a multiple of a tile's.
        side: cells along the side of a tile.
        in_space: True in 3D.
        most: filled, shape ((width / side)^d,), x fastest.
    """
    across, layers = width // side, width if in_space else 1
    most[:] = 0
    for channel in range(2):
        for z in range(layers):
            for y in range(width):
                tile = ((z // side) * across + y // side) * across
                at = (z * width + y) * width
                for i in range(across):
                    largest = counts[channel, at]
                    for x in range(side):
                        largest = max(largest, counts[channel, at + x])
                    at += side
                    most[tile + i] = max(most[tile + i], np.int64(largest))


@borrowing
def fill_tiles(
    tiles: TileArrays,
    side: int,
    counts: Counts,
    width: int,
    shift: int,
    begin: IntArray,
    most: IntArray,
    key: IntArray,
) -> None:
    """Make the tiles of a box that has none yet. The caller has ensured the capacity.

    Args:
        tiles: the tiles.
        side: cells along the side of a tile.
        counts: as in `tiles_in`.
        width: likewise.
        shift: log2 of the units in one count.
        begin: coordinates of the box's first tile, shape (d,), x first.
        most: from `tiles_in`.
        key: room for the coordinates of a tile, shape (d,).
    """
    in_space = begin.shape[0] == 3
    across, layers = width // side, side if in_space else 1
    for tile in range(most.shape[0]):
        if most[tile] == 0:
            continue
        rest = tile
        for axis in range(begin.shape[0]):
            key[axis] = begin[axis] + rest % across
            rest //= across
        slot = find_or_insert(tiles, key)
        narrow = shift == FRACTION_BITS and most[tile] <= NARROW_MAX
        row = -1 if narrow else wide_row(tiles, slot)
        x0, y0, z0 = (key[0] - begin[0]) * side, (key[1] - begin[1]) * side, np.int64(0)
        if in_space:
            z0 = (key[2] - begin[2]) * side
        for channel in (HITS, PASSES):
            for z in range(layers):
                for y in range(side):
                    at = ((z0 + z) * width + y0 + y) * width + x0
                    to = (z * side + y) * side
                    for x in range(side):
                        count = counts[channel, at + x]
                        if narrow:
                            tiles.narrow[slot, channel, to + x] = np.uint8(count)
                        else:
                            tiles.wide[row, channel, to + x] = np.int64(count) << shift
        if narrow:
            tiles.load[slot] = np.uint8(most[tile])
            if most[tile] == NARROW_MAX:
                tiles.counts[ANY_FULL] = 1
