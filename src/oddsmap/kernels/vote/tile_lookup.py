# SPDX-License-Identifier: Apache-2.0
"""Reading tiles: single cells, found by the hash of their tile, and the cells of a box."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.units import FRACTION_BITS, HITS, PASSES
from oddsmap.kernels.vote.tiles import TileArrays, find

__all__ = ["gather_counts", "look_up"]

IntArray = npt.NDArray[np.int64]


@borrowing
def look_up(
    tiles: TileArrays, side: int, index: IntArray, key: IntArray, hits: IntArray, passes: IntArray
) -> None:
    """Give the weights of cells, 0 where there is no tile.

    Args:
        tiles: the tiles.
        side: cells along the side of a tile.
        index: cells, shape (n, d), x first.
        key: room for the coordinates of a tile, shape (d,).
        hits: filled, shape (n,) [units].
        passes: likewise.
    """
    d = index.shape[1]
    slot, known = -1, False
    for i in range(index.shape[0]):
        # Neighbours mostly share a tile: the one before is tried before the hash is.
        same = known
        place, stride = 0, 1
        for axis in range(d):
            at = index[i, axis] // side
            place += (index[i, axis] - at * side) * stride
            stride *= side
            if at != key[axis]:
                key[axis], same = at, False
        if not same:
            slot, known = find(tiles, key), True
        hits[i], passes[i] = 0, 0
        if slot < 0:
            continue
        row = tiles.wide_of[slot]
        hits[i] = np.int64(tiles.narrow[slot, HITS, place]) << FRACTION_BITS
        passes[i] = np.int64(tiles.narrow[slot, PASSES, place]) << FRACTION_BITS
        if row >= 0:
            hits[i] += tiles.wide[row, HITS, place]
            passes[i] += tiles.wide[row, PASSES, place]


@borrowing
def gather_counts(
    tiles: TileArrays,
    side: int,
    slots: IntArray,
    begin: IntArray,
    width: int,
    shift: int,
    counts: npt.NDArray[np.unsignedinteger],
) -> None:
    """Copy the weights of some tiles into a square or a cube of cells, in the type it has.

    Args:
        tiles: the tiles.
        side: cells along the side of a tile.
        slots: of the tiles that reach into the box.
        begin: its first cell, shape (d,), x first.
        width: cells along its sides.
        shift: log2 of the units in one count; every weight is a multiple of them.
        counts: hits and passes, shape (2, width^d), x fastest; only what tiles hold is written.
    """
    in_space = begin.shape[0] == 3
    layers = side if in_space else 1
    for i in range(slots.shape[0]):
        slot = slots[i]
        row = tiles.wide_of[slot]
        x0 = tiles.coords[slot, 0] * side - begin[0]
        y0 = tiles.coords[slot, 1] * side - begin[1]
        z0 = tiles.coords[slot, 2] * side - begin[2] if in_space else np.int64(0)
        # The part of a row that lies in the box.
        left, right = max(-x0, 0), min(width - x0, side)
        for z in range(layers):
            if in_space and not 0 <= z0 + z < width:
                continue
            for y in range(side):
                if not 0 <= y0 + y < width:
                    continue
                of = (z * side + y) * side
                to = ((z0 + z) * width + y0 + y) * width + x0
                for channel in range(2):
                    for x in range(left, right):
                        units = np.int64(tiles.narrow[slot, channel, of + x]) << FRACTION_BITS
                        if row >= 0:
                            units += tiles.wide[row, channel, of + x]
                        counts[channel, to + x] = units >> shift
