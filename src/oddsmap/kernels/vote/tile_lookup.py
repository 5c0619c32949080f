# SPDX-License-Identifier: Apache-2.0
"""Reading single cells, found by the hash of their tile."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.units import FRACTION_BITS, HITS, PASSES
from oddsmap.kernels.vote.tiles import TileArrays, find

__all__ = ["look_up"]

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
