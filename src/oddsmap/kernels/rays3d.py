# SPDX-License-Identifier: Apache-2.0
"""Which cells of space does a ray pass? Exact, in slabs along its dominant axis.

The rules are those of `segments.py`, one dimension up: a ray passes a cell if and only if it has
positive length inside it. Along the dominant axis a (of three, then b and c) the ray is cut at the
cell borders into slabs. In one slab b and c each move by at most one cell, so a slab holds the cell
of entry, the cell of leaving, and, where both b and c change, the cell between: which one it is
depends on the border that is met first.

Positions at the borders are u_j = u_0 + j * slope in double precision, without a dependency from
slab to slab. An edge counts as touched when the ray comes within 2^-28 cell of it.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import inlined

__all__ = ["emit_ray", "ray_axis"]

TOUCH = 2.0**-28

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@inlined
def ray_axis(dx: float, dy: float, dz: float) -> int:
    """The dominant axis of a direction: 0, 1 or 2."""
    ax, ay, az = abs(dx), abs(dy), abs(dz)
    if ax >= ay:
        return 0 if ax >= az else 2
    return 1 if ay >= az else 2


@inlined
def _start_cell(position: float, rises: float) -> int:
    # First cell with positive length: a ray that falls from a border begins below it.
    return np.int64(math.ceil(position)) - 1 if rises < 0 else np.int64(math.floor(position))


@inlined
def _stop_cell(position: float, rises: float) -> int:
    # Last cell with positive length: a ray that rises to a border ends below it.
    return np.int64(math.ceil(position)) - 1 if rises > 0 else np.int64(math.floor(position))


@inlined
def _touch(slope: float) -> float:
    # At most half a slab's rise, or a nearly level ray would be moved out of its own cell.
    return math.copysign(min(TOUCH, 0.5 * abs(slope)), slope)


@inlined
def _not_past(cell: int, bound: int, rises: float) -> int:
    # `bound` lies ahead: rounding must not carry a cell beyond it.
    return max(cell, bound) if rises < 0 else min(cell, bound)


@inlined
def emit_ray(
    origin: FloatArray,
    ends: FloatArray,
    i: int,
    lo: IntArray,
    axis: int,
    skip: int,
    bits: int,
    blocks: IntArray,
    buffer: npt.NDArray[np.signedinteger],
) -> int:
    """List the cells that a ray passes, without the cell of its end point.

    Args:
        origin: start point [cells], shape (3,).
        ends: end points [cells], shape (n, 3).
        i: which one.
        lo: first cell of the window, shape (3,); every cell of the ray and one more around it
            lie above.
        axis: the ray's dominant axis, from `ray_axis`.
        skip: leading slabs that need not be listed.
        bits: log2 of the side of a block.
        blocks: how far apart blocks are along each axis in the window, in blocks, shape (3,).
        buffer: takes the cells' codes, (block << 3 * bits) + place in the block, shape
            (3, at least slabs + 1): the cells of entry, of leaving and between; any two may be
            the same.

    Returns:
        How many slabs were written to the buffer.
    """
    a = axis
    b = a + 1 if a < 2 else 0
    c = b + 1 if b < 2 else 0
    a0, b0, c0 = origin[a] - lo[a], origin[b] - lo[b], origin[c] - lo[c]
    a1, b1, c1 = ends[i, a] - lo[a], ends[i, b] - lo[b], ends[i, c] - lo[c]
    # End cells by the end point's own coordinates: no rounding may move a hit.
    a_end = np.int64(math.floor(ends[i, a])) - lo[a]
    b_end = np.int64(math.floor(ends[i, b])) - lo[b]
    c_end = np.int64(math.floor(ends[i, c])) - lo[c]
    da, db, dc = a1 - a0, b1 - b0, c1 - c0
    if da == 0.0:
        return 0
    step = 1 if da > 0 else -1
    first = _start_cell(origin[a], da) - lo[a]
    b_start, c_start = _start_cell(origin[b], db) - lo[b], _start_cell(origin[c], dc) - lo[c]
    b_stop, c_stop = _stop_cell(ends[i, b], db) - lo[b], _stop_cell(ends[i, c], dc) - lo[c]
    n = (a_end - first) * step
    to_border = first + 1 - a0 if da > 0 else a0 - first
    scale = 1.0 / abs(da)
    su, sv = db * scale, dc * scale
    # A level ray goes through the middle of its cells, wherever rounding has put it.
    u = b0 + to_border * su if db != 0.0 else b_start + 0.5
    v = c0 + to_border * sv if dc != 0.0 else c_start + 0.5
    tu, tv = _touch(su), _touch(sv)
    pu, pv = abs(su), abs(sv)

    mask = (1 << bits) - 1
    shift = 3 * bits
    # A code is a sum of one part an axis: the block's place and the place within the block.
    a_far, a_near = blocks[a] << shift, 1 << (bits * a)
    b_far, b_near = np.int32(blocks[b] << shift), np.int32(1 << (bits * b))
    c_far, c_near = np.int32(blocks[c] << shift), np.int32(1 << (bits * c))
    count = 0

    # Slab 0 up to slab n - 1, each to a border. Slab 0 begins at the start point, the others at
    # the border before; the loop below treats all but slab 0 alike, and is where the time goes.
    if n > 0 and skip == 0:
        eu, ev = b_start, c_start
        lu = -_not_past(-np.int64(u - tu), -eu, db)
        lv = -_not_past(-np.int64(v - tv), -ev, dc)
        place = (first >> bits) * a_far + (first & mask) * a_near
        near = abs(max(eu, lu) - b0) * pv
        other = abs(max(ev, lv) - c0) * pu
        mu, mv = eu, ev
        if near < other - TOUCH:
            mu = lu
        elif other < near - TOUCH:
            mv = lv
        _put(buffer, 0, 0, place, eu, ev, bits, mask, b_far, b_near, c_far, c_near)
        _put(buffer, 1, 0, place, lu, lv, bits, mask, b_far, b_near, c_far, c_near)
        _put(buffer, 2, 0, place, mu, mv, bits, mask, b_far, b_near, c_far, c_near)
        count = 1
    begin = max(1, skip)
    inner = max(0, n - begin)
    column = first + step * begin
    u_begin, v_begin = u + (begin - 1) * su, v + (begin - 1) * sv
    bits32, mask32 = np.int32(bits), np.int32(mask)
    for k in range(inner):
        at = column + step * k
        place = np.int32((at >> bits) * a_far + (at & mask) * a_near)
        u0, v0 = u_begin + k * su, v_begin + k * sv
        eu, ev = np.int32(u0 + tu), np.int32(v0 + tv)
        lu, lv = np.int32(u0 + su - tu), np.int32(v0 + sv - tv)
        near = abs(max(eu, lu) - u0) * pv
        other = abs(max(ev, lv) - v0) * pu
        e_b = (eu >> bits32) * b_far + (eu & mask32) * b_near
        l_b = (lu >> bits32) * b_far + (lu & mask32) * b_near
        e_c = (ev >> bits32) * c_far + (ev & mask32) * c_near
        l_c = (lv >> bits32) * c_far + (lv & mask32) * c_near
        m_b = l_b if near < other - TOUCH else e_b
        m_c = l_c if other < near - TOUCH else e_c
        to = np.uint64(count + k)
        buffer[0, to] = np.int32(place + e_b + e_c)
        buffer[1, to] = np.int32(place + l_b + l_c)
        buffer[2, to] = np.int32(place + m_b + m_c)
    count += inner

    # The last slab, from the last border (or the start) to the end point.
    if da > 0 and a1 <= math.floor(a1):
        return count
    u0, v0, eu, ev = b0, c0, b_start, c_start
    if n > 0:
        u0, v0 = u + (n - 1) * su, v + (n - 1) * sv
        eu, ev = np.int64(u0 + tu), np.int64(v0 + tv)
    lu, lv = b_stop, c_stop
    eu, ev = _not_past(eu, lu, db), _not_past(ev, lv, dc)
    place = (a_end >> bits) * a_far + (a_end & mask) * a_near
    near = abs(max(eu, lu) - u0) * pv
    other = abs(max(ev, lv) - v0) * pu
    mu, mv = eu, ev
    if near < other - TOUCH:
        mu = lu
    elif other < near - TOUCH:
        mv = lv
    # Any of the three may be the end point's cell, which is not listed; the entry stands in for
    # the others unless it is that cell itself, and then the ray passes nothing more here.
    if eu == b_end and ev == c_end:
        return count
    if lu == b_end and lv == c_end:
        lu, lv = eu, ev
    if mu == b_end and mv == c_end:
        mu, mv = eu, ev
    _put(buffer, 0, count, place, eu, ev, bits, mask, b_far, b_near, c_far, c_near)
    _put(buffer, 1, count, place, lu, lv, bits, mask, b_far, b_near, c_far, c_near)
    _put(buffer, 2, count, place, mu, mv, bits, mask, b_far, b_near, c_far, c_near)
    return count + 1


@inlined
def _put(
    buffer: npt.NDArray[np.signedinteger],
    row: int,
    at: int,
    place: int,
    u: int,
    v: int,
    bits: int,
    mask: int,
    b_far: int,
    b_near: int,
    c_far: int,
    c_near: int,
) -> None:
    code = place + (u >> bits) * b_far + (u & mask) * b_near
    buffer[row, np.uint64(at)] = code + (v >> bits) * c_far + (v & mask) * c_near
