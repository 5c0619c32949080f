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
    # First cell with positive length: a ray that falls from a border begins below it. (Written
    # without branches, as is all of the set-up: rays take them at random, 7 ns each.)
    cell = math.floor(position)
    return np.int64(cell) - np.int64((position == cell) & (rises < 0.0))


@inlined
def _stop_cell(position: float, rises: float) -> int:
    # Last cell with positive length: a ray that rises to a border ends below it.
    cell = math.floor(position)
    return np.int64(cell) - np.int64((position == cell) & (rises > 0.0))


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
            (3, at least slabs + 9): the cells of entry, of leaving and between; any two may be
            the same. Of 32 bits, which is twice as fast, or of 64 for windows past 2^31 cells.

    Returns:
        How many slabs were written to the buffer.
    """
    a = axis
    b = a + 1 if a < 2 else 0
    c = b + 1 if b < 2 else 0
    a0, b0, c0 = origin[a] - lo[a], origin[b] - lo[b], origin[c] - lo[c]
    # Not between places in the window: 1e-17 before a border is on it there.
    da, db, dc = ends[i, a] - origin[a], ends[i, b] - origin[b], ends[i, c] - origin[c]
    # End cells by the end point's own coordinates: no rounding may move a hit.
    a_end = np.int64(math.floor(ends[i, a])) - lo[a]
    b_end = np.int64(math.floor(ends[i, b])) - lo[b]
    c_end = np.int64(math.floor(ends[i, c])) - lo[c]
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

    # A code is a sum of one part an axis: the block's place and the place within the block.
    mask = (1 << bits) - 1
    shift = 3 * bits
    a_far, a_near = blocks[a] << shift, 1 << (bits * a)
    b_far, b_near = blocks[b] << shift, 1 << (bits * b)
    c_far, c_near = blocks[c] << shift, 1 << (bits * c)
    count = 0

    # Slab 0, from the start point to the first border.
    if n > 0 and skip == 0:
        lu = -_not_past(-np.int64(u - tu), -b_start, db)
        lv = -_not_past(-np.int64(v - tv), -c_start, dc)
        near = abs(max(b_start, lu) - b0) * pv
        other = abs(max(c_start, lv) - c0) * pu
        place = _part(first, bits, mask, a_far, a_near)
        e_b, l_b = _part(b_start, bits, mask, b_far, b_near), _part(lu, bits, mask, b_far, b_near)
        e_c, l_c = _part(c_start, bits, mask, c_far, c_near), _part(lv, bits, mask, c_far, c_near)
        buffer[0, 0] = place + e_b + e_c
        buffer[1, 0] = place + l_b + l_c
        m_b = l_b if near < other - TOUCH else e_b
        m_c = l_c if other < near - TOUCH else e_c
        buffer[2, 0] = place + m_b + m_c
        count = 1

    # Inner slabs, from border to border: this loop vectorises, and is where the time goes.
    begin = max(1, skip)
    inner = max(0, n - begin)
    column = first + step * begin
    u_begin, v_begin = u + (begin - 1) * su, v + (begin - 1) * sv
    code = buffer.dtype.type
    bits32, mask32 = np.int32(bits), np.int32(mask)
    b_far_code, b_near32 = code(b_far), np.int32(b_near)
    c_far_code, c_near32 = code(c_far), np.int32(c_near)
    # Rounded up to whole vectors: most rays list a dozen slabs, and a scalar rest would cost 10 %
    # of a scan. The buffer has room, and the rest is not counted.
    for k in range((inner + 7) & -8):
        place_code = code(_part(column + step * k, bits, mask, a_far, a_near))
        u0, v0 = u_begin + k * su, v_begin + k * sv
        eu, ev = np.int32(u0 + tu), np.int32(v0 + tv)
        lu, lv = np.int32(u0 + su - tu), np.int32(v0 + sv - tv)
        near = abs(max(eu, lu) - u0) * pv
        other = abs(max(ev, lv) - v0) * pu
        e_b = _part(eu, bits32, mask32, b_far_code, b_near32)
        l_b = _part(lu, bits32, mask32, b_far_code, b_near32)
        e_c = _part(ev, bits32, mask32, c_far_code, c_near32)
        l_c = _part(lv, bits32, mask32, c_far_code, c_near32)
        m_b = l_b if near < other - TOUCH else e_b
        m_c = l_c if other < near - TOUCH else e_c
        to = np.uint64(count + k)
        buffer[0, to] = code(place_code + e_b + e_c)
        buffer[1, to] = code(place_code + l_b + l_c)
        buffer[2, to] = code(place_code + m_b + m_c)
    count += inner

    # The last slab, from the last border (or the start) to the end point. Written without
    # branches, which rays would take at random.
    u0, v0, eu, ev = b0, c0, b_start, c_start
    if n > 0:
        u0, v0 = u + (n - 1) * su, v + (n - 1) * sv
        eu, ev = np.int64(u0 + tu), np.int64(v0 + tv)
    eu, ev = _not_past(eu, b_stop, db), _not_past(ev, c_stop, dc)
    near = abs(max(eu, b_stop) - u0) * pv
    other = abs(max(ev, c_stop) - v0) * pu
    place = _part(a_end, bits, mask, a_far, a_near)
    e_b, l_b = _part(eu, bits, mask, b_far, b_near), _part(b_stop, bits, mask, b_far, b_near)
    e_c, l_c = _part(ev, bits, mask, c_far, c_near), _part(c_stop, bits, mask, c_far, c_near)
    entry, leave = place + e_b + e_c, place + l_b + l_c
    m_b = l_b if near < other - TOUCH else e_b
    m_c = l_c if other < near - TOUCH else e_c
    between = place + m_b + m_c
    end = place + _part(b_end, bits, mask, b_far, b_near)
    end += _part(c_end, bits, mask, c_far, c_near)
    # The end point's cell is not listed: the entry stands in for it, unless it is that cell itself,
    # and then the ray passes nothing more. A ray that rises to a border has no length beyond it.
    to = np.uint64(count)
    buffer[0, to] = entry
    buffer[1, to] = entry if leave == end else leave
    buffer[2, to] = entry if between == end else between
    listed = np.int64(entry != end) & np.int64((da < 0.0) | (ends[i, a] > math.floor(ends[i, a])))
    return count + listed


@inlined
def _part(cell: int, bits: int, mask: int, far: int, near: int) -> int:
    return (cell >> bits) * far + (cell & mask) * near
