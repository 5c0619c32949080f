# SPDX-License-Identifier: Apache-2.0
"""Free cells beside unknown ones, and the clusters that they make, in blocks of states."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.query.state_blocks import BLOCK_BITS, UNKNOWN, StateBlocks
from oddsmap.kernels.vote.tiles import find

__all__ = ["MARK", "join_marked", "list_marked", "mark_frontiers"]

MARK = 16
"""A bit beside those of the states, of cells that are at a frontier and in no cluster yet."""

_LAST = (1 << BLOCK_BITS) - 1

IntArray = npt.NDArray[np.int64]


@borrowing
def mark_frontiers(
    blocks: StateBlocks, free: np.uint8, steps: IntArray, key: IntArray, near: IntArray
) -> int:
    """Mark the free cells that have an unknown neighbour.

    Args:
        blocks: the states of cells; `MARK` is set in those of the cells, and in `present`.
        free: the bit of free cells.
        steps: from a cell to each of its neighbours, shape (k, d).
        key: room for the coordinates of a block, shape (d,).
        near: room for the slots of a block and of those around it, shape (3^d,).

    Returns:
        How many are marked.
    """
    d = key.shape[0]
    count = 0
    for slot in range(blocks.counts[0]):
        if blocks.present[slot] & free == 0:
            continue
        for other in range(near.shape[0]):
            rest = other
            for a in range(d):
                key[a] = blocks.coords[slot, a] + rest % 3 - 1
                rest //= 3
            near[other] = find(blocks, key)
        for place in range(blocks.states.shape[1]):
            if blocks.states[slot, place] & free == 0:
                continue
            for step in range(steps.shape[0]):
                at, other, power = 0, 0, 1
                for a in range(d):
                    along = ((place >> (BLOCK_BITS * a)) & _LAST) + steps[step, a]
                    at |= (along & _LAST) << (BLOCK_BITS * a)
                    other += ((along >> BLOCK_BITS) + 1) * power
                    power *= 3
                there = near[other]
                if there < 0 or blocks.states[there, at] & UNKNOWN:
                    blocks.states[slot, place] |= np.uint8(MARK)
                    blocks.present[slot] |= np.uint8(MARK)
                    count += 1
                    break
    return count


@borrowing
def list_marked(blocks: StateBlocks, where: IntArray) -> None:
    """Name the marked cells by their slot and their place in the block, shape (n, 2)."""
    i = 0
    for slot in range(blocks.counts[0]):
        if blocks.present[slot] & MARK:
            for place in range(blocks.states.shape[1]):
                if blocks.states[slot, place] & MARK:
                    where[i, 0], where[i, 1] = slot, place
                    i += 1


@borrowing
def join_marked(
    blocks: StateBlocks,
    where: IntArray,
    steps: IntArray,
    key: IntArray,
    cells: IntArray,
    cluster: IntArray,
) -> int:
    """Gather the marked cells in clusters of neighbours; the marks are taken off.

    Args:
        blocks: the states of cells, some marked.
        where: the marked cells, as `list_marked` names them.
        steps: from a cell to each of its neighbours, shape (k, d).
        key: room for the coordinates of a block, shape (d,).
        cells: filled with the cells, cluster by cluster, shape (n, d).
        cluster: filled with the number of each cell's cluster, shape (n,).

    Returns:
        How many clusters there are.
    """
    d = key.shape[0]
    head, tail, number = 0, 0, 0
    for seed in range(where.shape[0]):
        slot, place = where[seed, 0], where[seed, 1]
        if blocks.states[slot, place] & MARK == 0:
            continue
        # `cells` is also the queue: what lies between head and tail has neighbours to be asked.
        blocks.states[slot, place] &= np.uint8(255 - MARK)
        for a in range(d):
            inside = (place >> (BLOCK_BITS * a)) & _LAST
            cells[tail, a] = (blocks.coords[slot, a] << BLOCK_BITS) + inside
        cluster[tail] = number
        tail += 1
        known = -2
        while head < tail:
            for step in range(steps.shape[0]):
                at, same = 0, known > -2
                for a in range(d):
                    along = cells[head, a] + steps[step, a]
                    at |= (along & _LAST) << (BLOCK_BITS * a)
                    if (along >> BLOCK_BITS) != key[a]:
                        key[a], same = along >> BLOCK_BITS, False
                if not same:
                    known = find(blocks, key)
                if known >= 0 and blocks.states[known, at] & MARK:
                    blocks.states[known, at] &= np.uint8(255 - MARK)
                    for a in range(d):
                        cells[tail, a] = cells[head, a] + steps[step, a]
                    cluster[tail] = number
                    tail += 1
            head += 1
        number += 1
    return number
