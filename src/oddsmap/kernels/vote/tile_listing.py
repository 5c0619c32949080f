# SPDX-License-Identifier: Apache-2.0
"""The cells in the tiles, some at a time: in rows, and in the order of an octree.

No cell is sorted: tiles are, and the cells inside a tile have an order already.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.units import HITS, PASSES
from oddsmap.kernels.vote.tile_census import weight_of
from oddsmap.kernels.vote.tiles import TileArrays

__all__ = ["list_cells", "list_codes"]

IntArray = npt.NDArray[np.int64]


@borrowing
def list_cells(
    tiles: TileArrays,
    side: int,
    order: IntArray,
    rows: IntArray,
    words: npt.NDArray[np.uint64],
    at: IntArray,
    index: IntArray,
    hits: IntArray,
    passes: IntArray,
) -> int:
    """List cells with a weight in order of their index, x changing fastest.

    A row of cells of one y and z is listed whole, or later.

    Args:
        tiles: the tiles.
        side: cells along the side of a tile.
        order: slots of the tiles in order of their coordinates, x changing fastest, shape (n,).
        rows: where tiles of another y or z begin in `order`, and its end.
        words: `tiles.narrow`, eight cells at a time, to pass over many at once; of size 0 where a
            tile's side is no multiple of eight.
        at: at[0] is the number of the row of cells to begin with, 0 at first; then of the one to go
            on with, -1 at the end.
        index: filled, shape (room, d), x first; room for the longest row at least.
        hits: filled, shape (room,) [units].
        passes: likewise.

    Returns:
        How many cells were listed.
    """
    in_space = index.shape[1] == 3
    layers = side if in_space else 1
    found, first, number = 0, 0, np.int64(0)
    while first < rows.shape[0] - 1:
        # In space the rows of tiles that share z are gone through layer by layer.
        past = first + 1
        z_tile = tiles.coords[order[rows[first]], 2] if in_space else np.int64(0)
        while in_space and past < rows.shape[0] - 1:
            if tiles.coords[order[rows[past]], 2] != z_tile:
                break
            past += 1
        here = (past - first) * side * layers
        for place in range(max(at[0] - number, 0), here):
            z = place // ((past - first) * side)
            run = first + place // side % (past - first)
            y = place % side
            if found + (rows[run + 1] - rows[run]) * side > index.shape[0]:
                at[0] = number + place
                return found
            along = (z * side + y) * side
            for i in range(rows[run], rows[run + 1]):
                slot = order[i]
                row = tiles.wide_of[slot]
                for begin in range(0, side, 8):
                    if row < 0 and words.shape[2] > 0:
                        word = (along + begin) >> 3
                        if words[slot, HITS, word] | words[slot, PASSES, word] == 0:
                            continue
                    for x in range(begin, min(begin + 8, side)):
                        h = weight_of(tiles, slot, row, HITS, along + x)
                        p = weight_of(tiles, slot, row, PASSES, along + x)
                        if h | p == 0:
                            continue
                        index[found, 0] = tiles.coords[slot, 0] * side + x
                        index[found, 1] = tiles.coords[slot, 1] * side + y
                        if in_space:
                            index[found, 2] = z_tile * side + z
                        hits[found], passes[found] = h, p
                        found += 1
        number += here
        first = past
    at[0] = -1
    return found


@borrowing
def list_codes(
    tiles: TileArrays,
    order: IntArray,
    first: IntArray,
    inside: IntArray,
    at: IntArray,
    code: IntArray,
    hits: IntArray,
    passes: IntArray,
) -> int:
    """List cells with a weight in order of their Morton codes, in space.

    Args:
        tiles: the tiles, whose side is a power of two.
        order: slots of the tiles in order of their codes, shape (n,).
        first: the code of each one's first cell, in that order, shape (n,).
        inside: the cells of a tile in order of their codes, shape (side^3,).
        at: at[0] is where in `order` to begin; then where to go on.
        code: filled, shape (room,); room for the cells of a tile at least.
        hits: filled, shape (room,) [units].
        passes: likewise.

    Returns:
        How many cells were listed.
    """
    found = 0
    while at[0] < order.shape[0] and found + inside.shape[0] <= code.shape[0]:
        slot = order[at[0]]
        row = tiles.wide_of[slot]
        for k in range(inside.shape[0]):
            h = weight_of(tiles, slot, row, HITS, inside[k])
            p = weight_of(tiles, slot, row, PASSES, inside[k])
            if h | p == 0:
                continue
            code[found], hits[found], passes[found] = first[at[0]] + k, h, p
            found += 1
        at[0] += 1
    return found
