# SPDX-License-Identifier: Apache-2.0
"""The first cell of given states along each ray, by exact traversal of sparse blocks.

The rules are those of mapping (`trace/segments2d.py`): a ray passes a cell if and only if it has
positive length inside it. From the cell it is in a ray goes on over the border that it meets first.
Borders that it meets at one place are crossed together, so that a touched edge or corner gives no
cell: they are met at one place if they lie within 2^-28 cell of each other, as in mapping, where
the slower axis decides, and never more than half a cell along the faster one, or a nearly level ray
would leave its cells too early.

A border's place on the ray is (border - start) / direction, worked out anew for each, by the
inverse of the direction: nothing adds up along the way, and start points far from the origin lose
no bit. A block that has none of the states in question is passed in one step.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined
from oddsmap.kernels.query.state_blocks import BLOCK_BITS, UNKNOWN, StateBlocks
from oddsmap.kernels.vote.tiles import find

__all__ = ["ROOM", "walk_rays"]

TOUCH = 2.0**-28

BORDER, PER, TOGETHER, ROOM = 0, 1, 2, 5
"""Rows of a ray's room, one number per axis in each: where the next border is met, one over the
direction, and, a row for each axis, how far apart borders of it and of another are met at one
place; how many rows."""

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@inlined
def _border(cell: int, rises: int, start: float, per: float) -> float:
    # Where a ray leaves a cell along one axis; never along an axis it is level in.
    return (float(cell + rises) - start) * per if np.isfinite(per) else np.inf


@borrowing
def _jump(
    start: FloatArray, way: FloatArray, s: float, axis: int, cell: IntArray, room: FloatArray
) -> None:
    """Go on to a place on the ray that is a border along one axis, over which `cell` already is."""
    for b in range(start.shape[0]):
        rises = 1 if way[b] > 0.0 else 0
        per = room[PER, b]
        if b != axis and np.isfinite(per):
            step = 2 * rises - 1
            at = np.int64(np.floor(start[b] + way[b] * s))
            # Rounding may be off by a cell: the borders themselves decide.
            if (at - cell[b]) * step > 1:
                cell[b] = at - step
            reached = s + room[TOGETHER + axis, b]
            while _border(cell[b], rises, start[b], per) <= reached:
                cell[b] += step
        room[BORDER, b] = _border(cell[b], rises, start[b], per)


@borrowing
def _set_up(start: FloatArray, way: FloatArray, cell: IntArray, room: FloatArray) -> None:
    """The cell that a ray starts in, and what its steps need."""
    d = start.shape[0]
    for a in range(d):
        first = np.floor(start[a])
        # A ray that falls from a border begins below it.
        cell[a] = np.int64(first) - (1 if (first == start[a]) & (way[a] < 0.0) else 0)
        room[PER, a] = 1.0 / way[a] if way[a] != 0.0 else np.inf
        room[BORDER, a] = _border(cell[a], 1 if way[a] > 0.0 else 0, start[a], room[PER, a])
        for b in range(d):
            slow, fast = min(abs(way[a]), abs(way[b])), max(abs(way[a]), abs(way[b]))
            near = min(TOUCH / slow, 0.5 / fast) if slow > 0.0 else 0.0
            room[TOGETHER + a, b] = near


@borrowing
def walk_rays(
    blocks: StateBlocks,
    lo: IntArray,
    hi: IntArray,
    origins: FloatArray,
    directions: FloatArray,
    reach: float,
    stop: np.uint8,
    room: FloatArray,
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
        room: shape (ROOM, d).
        cells: room for two cells, shape (2, d).
        distance: filled where a cell ends the ray: how far it is entered, in lengths of the
            direction, shape (n,).
        met: likewise, the cell, shape (n, d).
        ended: likewise, its state, shape (n,).
    """
    d = origins.shape[1]
    cell, key = cells[0], cells[1]
    for ray in range(origins.shape[0]):
        start, way = origins[ray], directions[ray]
        _set_up(start, way, cell, room)
        end, entry, s = reach, -1, 0.0
        inside = True
        if stop & UNKNOWN == 0:
            # Nothing can end it outside the box.
            for a in range(d):
                if not np.isfinite(room[PER, a]):
                    inside &= (cell[a] >= lo[a]) & (cell[a] < hi[a])
                else:
                    one, other = (
                        (lo[a] - start[a]) * room[PER, a],
                        (hi[a] - start[a]) * room[PER, a],
                    )
                    if min(one, other) > s:
                        entry, s = a, min(one, other)
                    end = min(end, max(one, other))
        if not inside or s >= end:
            continue
        if entry >= 0:
            cell[entry] = lo[entry] if way[entry] > 0.0 else hi[entry] - 1
            _jump(start, way, s, entry, cell, room)
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
                    if np.isfinite(room[PER, a]):
                        last = (key[a] + (1 if way[a] > 0.0 else 0)) << BLOCK_BITS
                        leave = (last - start[a]) * room[PER, a]
                        if leave < s:
                            axis, s = a, leave
                step = 1 if way[axis] > 0.0 else -1
                cell[axis] = ((key[axis] + (1 if step > 0 else 0)) << BLOCK_BITS) - (
                    0 if step > 0 else 1
                )
                _jump(start, way, s, axis, cell, room)
                continue
            state = blocks.states[slot, place] if slot >= 0 else np.uint8(UNKNOWN)
            if state & stop:
                distance[ray], ended[ray] = s, state
                for a in range(d):
                    met[ray, a] = cell[a]
                break
            axis = 0
            for a in range(1, d):
                if room[BORDER, a] < room[BORDER, axis]:
                    axis = a
            s = room[BORDER, axis]
            for a in range(d):
                if a == axis or room[BORDER, a] - s <= room[TOGETHER + axis, a]:
                    rises = 1 if way[a] > 0.0 else 0
                    cell[a] += 2 * rises - 1
                    room[BORDER, a] = _border(cell[a], rises, start[a], room[PER, a])
