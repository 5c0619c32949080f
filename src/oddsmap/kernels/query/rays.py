# SPDX-License-Identifier: Apache-2.0
"""The first cell of given states along each ray, by exact traversal of sparse blocks.

The rules are those of mapping (`trace/segments2d.py`): a ray passes a cell if and only if it has
positive length inside it. From the cell it is in a ray goes on over the border that it meets first.
Borders that it meets at one place are crossed together, so that a touched edge or corner gives no
cell: they are met at one place if they lie within 2^-28 cell of each other, as in mapping, where
the slower axis decides, and never more than half a cell along the faster one, or a nearly level ray
would leave its cells too early.

A border's place on the ray is (border - start) / direction, worked out anew for each: nothing adds
up along the way, and start points far from the origin lose no bit. A block that has none of the
states in question is passed in one step.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined
from oddsmap.kernels.query.state_blocks import BLOCK_BITS, UNKNOWN, StateBlocks
from oddsmap.kernels.vote.tiles import find

__all__ = ["walk_rays"]

TOUCH = 2.0**-28

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@inlined
def _together(apart: float, one: float, other: float) -> bool:
    # Whether two borders so far apart along a ray are met at one place; speeds along their axes.
    slow, fast = min(abs(one), abs(other)), max(abs(one), abs(other))
    return (apart * slow <= TOUCH) & (apart * fast <= 0.5)


@inlined
def _border(cell: int, start: float, way: float) -> float:
    # Where a ray leaves a cell along one axis.
    if way == 0.0:
        return np.inf
    return (float(cell + (1 if way > 0.0 else 0)) - start) / way


@borrowing
def _jump(
    start: FloatArray, way: FloatArray, s: float, axis: int, cell: IntArray, border: FloatArray
) -> None:
    """Go on to a place on the ray that is a border along one axis, over which `cell` already is."""
    for b in range(start.shape[0]):
        if b != axis and way[b] != 0.0:
            step = 1 if way[b] > 0.0 else -1
            at = np.int64(np.floor(start[b] + way[b] * s))
            # Rounding may be off by a cell: the borders themselves decide.
            if (at - cell[b]) * step > 2:
                cell[b] = at - 2 * step
            ahead = _border(cell[b], start[b], way[b])
            while ahead <= s or _together(ahead - s, way[b], way[axis]):
                cell[b] += step
                ahead = _border(cell[b], start[b], way[b])
        border[b] = _border(cell[b], start[b], way[b])


@borrowing
def walk_rays(
    blocks: StateBlocks,
    lo: IntArray,
    hi: IntArray,
    origins: FloatArray,
    directions: FloatArray,
    reach: float,
    stop: np.uint8,
    borders: FloatArray,
    cells: IntArray,
    distance: FloatArray,
    met: IntArray,
    ended: npt.NDArray[np.uint8],
) -> None:
    """Walk along rays until a cell has one of some states.

    Args:
        blocks: the states of cells.
        lo: first cell of the box of all blocks, shape (d,).
        hi: past its last cell.
        origins: where rays start [cells], shape (n, d).
        directions: not zero, shape (n, d).
        reach: how far rays go, in lengths of their directions.
        stop: the states that end a ray.
        borders: room, shape (2, d).
        cells: room, shape (2, d).
        distance: filled where a cell ends the ray: how far it is entered, in lengths of the
            direction, shape (n,).
        met: likewise, the cell, shape (n, d).
        ended: likewise, its state, shape (n,).
    """
    d = origins.shape[1]
    border, cell, key = borders[0], cells[0], cells[1]
    for ray in range(origins.shape[0]):
        start, way = origins[ray], directions[ray]
        end, entry, s = reach, -1, 0.0
        inside = True
        for a in range(d):
            first = np.floor(start[a])
            # A ray that falls from a border begins below it.
            cell[a] = np.int64(first) - (1 if (first == start[a]) & (way[a] < 0.0) else 0)
            border[a] = _border(cell[a], start[a], way[a])
            if stop & UNKNOWN == 0:
                # Nothing can end it outside the box.
                if way[a] == 0.0:
                    inside &= (cell[a] >= lo[a]) & (cell[a] < hi[a])
                else:
                    one, other = (lo[a] - start[a]) / way[a], (hi[a] - start[a]) / way[a]
                    if min(one, other) > s:
                        entry, s = a, min(one, other)
                    end = min(end, max(one, other))
        if not inside or s >= end:
            continue
        if entry >= 0:
            cell[entry] = lo[entry] if way[entry] > 0.0 else hi[entry] - 1
            _jump(start, way, s, entry, cell, border)
        slot, known = -1, False
        while s < end:
            same = known
            place = 0
            for a in range(d):
                at = cell[a] >> BLOCK_BITS
                place |= (cell[a] - (at << BLOCK_BITS)) << (BLOCK_BITS * a)
                if not known or at != key[a]:
                    key[a], same = at, False
            if not same:
                slot, known = find(blocks, key), True
            if (blocks.present[slot] if slot >= 0 else UNKNOWN) & stop == 0:
                # Through the block at once.
                axis, s = -1, np.inf
                for a in range(d):
                    if way[a] != 0.0:
                        last = (key[a] + (1 if way[a] > 0.0 else 0)) << BLOCK_BITS
                        leave = (last - start[a]) / way[a]
                        if leave < s:
                            axis, s = a, leave
                step = 1 if way[axis] > 0.0 else -1
                cell[axis] = ((key[axis] + (1 if step > 0 else 0)) << BLOCK_BITS) - (
                    0 if step > 0 else 1
                )
                _jump(start, way, s, axis, cell, border)
                continue
            state = blocks.states[slot, place] if slot >= 0 else np.uint8(UNKNOWN)
            if state & stop:
                distance[ray], ended[ray] = s, state
                for a in range(d):
                    met[ray, a] = cell[a]
                break
            axis = 0
            for a in range(1, d):
                if border[a] < border[axis]:
                    axis = a
            s = border[axis]
            for a in range(d):
                if a == axis or (way[a] != 0.0 and _together(border[a] - s, way[a], way[axis])):
                    cell[a] += 1 if way[a] > 0.0 else -1
                    border[a] = _border(cell[a], start[a], way[a])
