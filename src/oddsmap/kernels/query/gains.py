# SPDX-License-Identifier: Apache-2.0
"""What beams are expected to tell of the cells along them.

A beam ends in the first occupied cell. With o_j the probability that cell j is occupied, cells
independent of each other, it ends in cell j with probability

    P_j = o_j * product of (1 - o_i) over the cells i before it,

and tells then what a hit says of cell j and a pass of each cell before it. The sum over all j of
P_j times that is built up cell by cell, with the product and the sum of passes so far.

Rays go from cell to cell by the rules of `rays.py`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined
from oddsmap.kernels.query.state_blocks import BLOCK_BITS
from oddsmap.kernels.vote.tiles import find

__all__ = ["LEAST", "MAX_REACH", "Met", "RowBlocks", "Told", "add_up_gains", "gain_of_scan"]

LEAST = 1e-12
"""A beam is followed until less than this probability is left that it goes on."""

MAX_REACH = 1 << 19
"""Cells that a beam may reach: what tells cells apart has 21 bits for each axis."""

_LAST = (1 << BLOCK_BITS) - 1
_TOUCH = 2.0**-28
_AXIS = 21
_HALF = 1 << 20

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class RowBlocks(NamedTuple):
    """Blocks of cells, each cell with the number of a row; otherwise as `StateBlocks`."""

    table: npt.NDArray[np.int64]
    coords: npt.NDArray[np.int64]
    counts: npt.NDArray[np.int64]
    states: npt.NDArray[np.uint32]
    """The row of each cell, shape (capacity, cells of a block), x fastest."""


class Met(NamedTuple):
    """The cells that a beam meets, in order."""

    row: npt.NDArray[np.uint32]
    """Their rows, shape (most cells of a beam,)."""
    code: npt.NDArray[np.int64]
    """What tells them apart, likewise."""
    ends: npt.NDArray[np.int64]
    """How many of them are cleared where nothing is met, shape (1,)."""
    left: npt.NDArray[np.float64]
    """The probability that nothing is met, shape (1,)."""


class Told(NamedTuple):
    """The cells that a scan speaks of, in a hash table whose length is a power of two."""

    code: npt.NDArray[np.int64]
    """The cell in each slot, -1 where there is none."""
    left: npt.NDArray[np.float64]
    """The largest probability that a beam gets there."""
    gain: npt.NDArray[np.float64]
    """What this beam is expected to tell of it."""
    used: npt.NDArray[np.int64]
    """Slots in use, in order, shape (most cells of a scan,)."""


@inlined
def _first_cell(start: float, way: float) -> int:
    # A ray that falls from a border begins below it.
    cell = np.int64(np.floor(start))
    return cell - 1 if (float(cell) == start) & (way < 0.0) else cell


@inlined
def _border(cell: int, rises: int, start: float, per: float) -> float:
    # Where a ray leaves a cell along one axis; never along an axis it is level in.
    return (float(cell + rises) - start) * per if np.isfinite(per) else np.inf


@inlined
def _together(a: float, b: float) -> float:
    # How far apart borders of two axes are met at one place, by the inverses of their directions.
    return min(_TOUCH * max(abs(a), abs(b)), 0.5 * min(abs(a), abs(b)))


@borrowing
def _follow(
    blocks: RowBlocks,
    rows: FloatArray,
    start: FloatArray,
    way: FloatArray,
    reach: float,
    clear: float,
    met: Met,
    key: IntArray,
) -> int:
    """Note the cells that a beam meets until it is as good as ended; how many there are."""
    d = start.shape[0]
    px, py, pz = start[0], start[1], 0.5
    vx, vy, vz = way[0], way[1], 0.0
    if d == 3:
        pz, vz = start[2], way[2]
    x, y, z = _first_cell(px, vx), _first_cell(py, vy), _first_cell(pz, vz)
    # Cells are told apart by where they lie seen from the cell that holds the sensor.
    x0, y0, z0 = (
        np.int64(np.floor(px)) - _HALF,
        np.int64(np.floor(py)) - _HALF,
        np.int64(np.floor(pz)) - _HALF,
    )
    ix = 1.0 / vx if vx != 0.0 else np.inf
    iy = 1.0 / vy if vy != 0.0 else np.inf
    iz = 1.0 / vz if vz != 0.0 else np.inf
    rx, ry, rz = np.int64(vx > 0.0), np.int64(vy > 0.0), np.int64(vz > 0.0)
    xy, xz, yz = _together(ix, iy), _together(ix, iz), _together(iy, iz)
    bx, by, bz = _border(x, rx, px, ix), _border(y, ry, py, iy), _border(z, rz, pz, iz)
    s, left = 0.0, 1.0
    slot, known = -1, False
    count, cleared = 0, 0
    while s < reach and left >= LEAST:
        at_x, at_y, at_z = x >> BLOCK_BITS, y >> BLOCK_BITS, z >> BLOCK_BITS
        if not known or at_x != key[0] or at_y != key[1] or (d == 3 and at_z != key[2]):
            key[0], key[1], known = at_x, at_y, True
            if d == 3:
                key[2] = at_z
            slot = find(blocks, key)
        row = np.uint32(0)
        if slot >= 0:
            place = (x & _LAST) | ((y & _LAST) << BLOCK_BITS)
            if d == 3:
                place |= (z & _LAST) << (2 * BLOCK_BITS)
            row = blocks.states[slot, place]
        met.row[count] = row
        met.code[count] = (x - x0) | ((y - y0) << _AXIS) | ((z - z0) << (2 * _AXIS))
        count += 1
        if s < clear:
            cleared = count
        left *= 1.0 - rows[row, 0]
        # On to the next cell; borders that are met at one place are crossed together.
        s = min(bx, by, bz)
        over_x = bx == s
        over_y = by == s and not over_x
        over_z = not over_x and not over_y
        near_x, near_y, near_z = xz, yz, xz
        if over_x:
            near_y, near_z = xy, xz
        elif over_y:
            near_x, near_z = xy, yz
        else:
            near_x, near_y = xz, yz
        if over_x or bx - s <= near_x:
            x += 2 * rx - 1
            bx = _border(x, rx, px, ix)
        if over_y or by - s <= near_y:
            y += 2 * ry - 1
            by = _border(y, ry, py, iy)
        if over_z or bz - s <= near_z:
            z += 2 * rz - 1
            bz = _border(z, rz, pz, iz)
    met.ends[0] = cleared
    met.left[0] = left if left >= LEAST else 0.0
    return count


@borrowing
def add_up_gains(
    blocks: RowBlocks,
    rows: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    reach: float,
    clear: float,
    met: Met,
    key: IntArray,
    gains: FloatArray,
) -> None:
    """Add up what each of some beams is expected to tell.

    Args:
        blocks: the row of each cell; those in no block have row 0.
        rows: the probability that such a cell is occupied, what a hit tells of it, and what a pass
            does, shape (k, 3).
        origins: where beams start [cells], shape (n, d).
        directions: unit vectors, shape (n, d).
        reach: a return comes from a cell that is entered before this [cells].
        clear: a beam without a return tells of the cells that are entered before this [cells].
        met: room for the cells of a beam.
        key: room for the coordinates of a block, shape (d,).
        gains: filled, shape (n,).
    """
    for ray in range(origins.shape[0]):
        start, way = origins[ray], directions[ray]
        count = _follow(blocks, rows, start, way, reach, clear, met, key)
        left, passes, total = 1.0, 0.0, 0.0
        cleared = 0.0
        for i in range(count):
            row = met.row[i]
            total += left * rows[row, 0] * (passes + rows[row, 1])
            left *= 1.0 - rows[row, 0]
            passes += rows[row, 2]
            if i < met.ends[0]:
                cleared = passes
        gains[ray] = total + met.left[0] * cleared


@borrowing
def gain_of_scan(
    blocks: RowBlocks,
    rows: FloatArray,
    origin: FloatArray,
    directions: FloatArray,
    reach: float,
    clear: float,
    met: Met,
    key: IntArray,
    told: Told,
) -> float:
    """What a scan is expected to tell if it speaks of each cell once.

    Of the beams that meet a cell the one counts that most probably gets there.

    Args:
        blocks: as in `add_up_gains`, as all that follow but the origin and the last.
        rows: likewise.
        origin: where all beams start [cells], shape (d,).
        directions: likewise.
        reach: likewise.
        clear: likewise.
        met: likewise.
        key: likewise.
        told: room for the cells of the scan; empty before and after.
    """
    mask = np.uint64(told.code.shape[0] - 1)
    used = 0
    for ray in range(directions.shape[0]):
        way = directions[ray]
        count = _follow(blocks, rows, origin, way, reach, clear, met, key)
        left = 1.0
        for i in range(count):
            row, code = met.row[i], met.code[i]
            after = left * (1.0 - rows[row, 0])
            passes = after if i < met.ends[0] else after - met.left[0]
            gain = left * rows[row, 0] * rows[row, 1] + passes * rows[row, 2]
            at = (np.uint64(code) * np.uint64(0x9E3779B97F4A7C15) >> np.uint64(24)) & mask
            while told.code[at] >= 0 and told.code[at] != code:
                at = (at + np.uint64(1)) & mask
            if told.code[at] < 0:
                told.code[at], told.left[at] = code, -1.0
                told.used[used] = at
                used += 1
            if left > told.left[at]:
                told.left[at], told.gain[at] = left, gain
            left = after
    total = 0.0
    for i in range(used):
        at = told.used[i]
        total += told.gain[at]
        told.code[at] = -1
    return total
