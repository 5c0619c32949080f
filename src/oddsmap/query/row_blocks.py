# SPDX-License-Identifier: Apache-2.0
"""Probabilities of cells in blocks: a row of numbers for each that occurs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, cast

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.kernels.query.gains import RowBlocks
from oddsmap.kernels.query.state_blocks import BLOCK_BITS, put_states
from oddsmap.kernels.vote.tiles import enter

__all__ = ["fill_rows"]

_FIRST_BLOCKS = 64


def fill_rows(
    ndim: int, parts: Iterable[tuple[IntArray, FloatArray]], unknown: float
) -> tuple[RowBlocks, FloatArray]:
    """Number the probabilities that occur, and put the number of each cell's into blocks.

    Evidence makes few of them, so what is worked out of a probability is worked out once, and a
    cell takes 4 bytes.

    Args:
        ndim: 2 or 3.
        parts: the known cells, some at a time: index, shape (n, d), and probability, shape (n,).
        unknown: the probability of all others: that of row 0.

    Returns:
        The blocks, and the probability of each row.
    """
    numbers = {unknown: 0}
    blocks = _resized(_empty(ndim, 0), _FIRST_BLOCKS)
    key = np.zeros(ndim, np.int64)
    for index, probability in parts:
        values, which = np.unique(probability, return_inverse=True)
        known = [numbers.setdefault(value, len(numbers)) for value in values.tolist()]
        rows = np.array(known, np.uint32)[which.reshape(-1)]
        index, done = np.ascontiguousarray(index, np.int64), 0
        while True:
            done = put_states(cast(Any, blocks), index, cast(Any, rows), done, key)
            if done == len(index):
                break
            blocks = _resized(blocks, 2 * len(blocks.coords))
    return _resized(blocks, int(blocks.counts[0])), np.array(list(numbers), np.float64)


def _empty(ndim: int, count: int) -> RowBlocks:
    slots = 64
    while slots < 2 * count:
        slots *= 2
    return RowBlocks(
        table=np.full(slots, -1, np.int64),
        coords=np.zeros((count, ndim), np.int64),
        counts=np.zeros(1, np.int64),
        states=np.zeros((count, 1 << (BLOCK_BITS * ndim)), np.uint32),
    )


def _resized(blocks: RowBlocks, count: int) -> RowBlocks:
    """The same blocks with room for so many."""
    used = int(blocks.counts[0])
    new = _empty(blocks.coords.shape[1], count)
    new.coords[:used], new.states[:used] = blocks.coords[:used], blocks.states[:used]
    new.counts[0] = used
    enter(new, 0)
    return new
