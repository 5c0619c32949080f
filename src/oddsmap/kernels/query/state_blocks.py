# SPDX-License-Identifier: Apache-2.0
"""States of cells in blocks that are found by hash, one bit of a byte for each state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.vote.tiles import enter, find

__all__ = ["BLOCK_BITS", "UNKNOWN", "StateBlocks", "put_states"]

BLOCK_BITS = 3
"""log2 of a block's side. A ray passes a block without any of its last states in one step: 8 cells
are few enough that many are such, and enough to be worth the look-up."""
UNKNOWN = 1
"""The bit of unknown cells, those in no block among them."""

IntArray = npt.NDArray[np.int64]


class StateBlocks(NamedTuple):
    """Blocks of cells; the first three are as in `TileArrays`."""

    table: npt.NDArray[np.int64]
    """Open-addressing hash, a power of two long: slot of a block, or -1."""
    coords: npt.NDArray[np.int64]
    """Coordinates of each block, shape (capacity, d), x first."""
    counts: npt.NDArray[np.int64]
    """Blocks used, shape (1,)."""
    states: npt.NDArray[np.uint8]
    """The bit of each cell's state, shape (capacity, cells of a block), x fastest."""
    present: npt.NDArray[np.uint8]
    """Which bits occur in each block, shape (capacity,)."""


@borrowing
def put_states(
    blocks: StateBlocks, index: IntArray, bits: npt.NDArray[np.uint8], start: int, key: IntArray
) -> int:
    """Set the states of cells; blocks are made where there is room.

    Args:
        blocks: the blocks.
        index: cells, shape (n, d), x first.
        bits: their states, shape (n,).
        start: the first cell to be set.
        key: room for the coordinates of a block, shape (d,).

    Returns:
        The first cell that was not set, as there is no room for its block; n where all were.
    """
    d = index.shape[1]
    slot = -1
    for i in range(start, index.shape[0]):
        same = slot >= 0
        place = 0
        for axis in range(d):
            at = index[i, axis] >> BLOCK_BITS
            place |= (index[i, axis] - (at << BLOCK_BITS)) << (BLOCK_BITS * axis)
            if at != key[axis]:
                key[axis], same = at, False
        if not same:
            slot = find(blocks, key)
            if slot < 0:
                slot = blocks.counts[0]
                if slot == blocks.coords.shape[0]:
                    return i
                for axis in range(d):
                    blocks.coords[slot, axis] = key[axis]
                blocks.counts[0] += 1
                enter(blocks, slot)
        blocks.states[slot, place] = bits[i]
    return index.shape[0]
