# SPDX-License-Identifier: Apache-2.0
"""The states of a map's cells in blocks, one byte per cell, as rays read them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.kernels.query.state_blocks import BLOCK_BITS, UNKNOWN, StateBlocks, put_states
from oddsmap.kernels.vote.tiles import enter
from oddsmap.odds import State

__all__ = ["bit_of", "fill_blocks"]

_BITS = {State.UNKNOWN: UNKNOWN, State.FREE: 2, State.UNDECIDED: 4, State.OCCUPIED: 8}
_FIRST_ROWS = 64


def bit_of(state: State) -> int:
    """One bit for each state: several of them make a set."""
    return _BITS[state]


def fill_blocks(ndim: int, parts: Iterable[tuple[IntArray, npt.NDArray[np.int8]]]) -> StateBlocks:
    """Put the known cells into blocks.

    Args:
        ndim: 2 or 3.
        parts: some cells at a time: index, shape (n, d), and state, shape (n,).

    Returns:
        The blocks, as many as there is room for.
    """
    table = np.zeros(256, np.uint8)
    for each, bit in _BITS.items():
        table[each % 256] = bit
    blocks = _resized(_empty(ndim, 0), _FIRST_ROWS)
    key = np.zeros(ndim, np.int64)
    for index, state in parts:
        bits = table[np.ascontiguousarray(state, np.int8).view(np.uint8)]
        index, done = np.ascontiguousarray(index, np.int64), 0
        while (done := put_states(blocks, index, bits, done, key)) < len(index):
            blocks = _resized(blocks, 2 * len(blocks.coords))
    used = int(blocks.counts[0])
    present = np.bitwise_or.reduce(blocks.states[:used], axis=1)
    return _resized(blocks, used)._replace(present=present)


def _empty(ndim: int, rows: int) -> StateBlocks:
    slots = 64
    while slots < 2 * rows:
        slots *= 2
    return StateBlocks(
        table=np.full(slots, -1, np.int64),
        coords=np.zeros((rows, ndim), np.int64),
        counts=np.zeros(1, np.int64),
        states=np.full((rows, 1 << (BLOCK_BITS * ndim)), UNKNOWN, np.uint8),
        present=np.zeros(rows, np.uint8),
    )


def _resized(blocks: StateBlocks, rows: int) -> StateBlocks:
    """The same blocks with room for so many."""
    used = int(blocks.counts[0])
    new = _empty(blocks.coords.shape[1], rows)
    new.coords[:used], new.states[:used] = blocks.coords[:used], blocks.states[:used]
    new.counts[0] = used
    enter(new, 0)
    return new
