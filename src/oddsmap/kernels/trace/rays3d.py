# SPDX-License-Identifier: Apache-2.0
"""Which 3D cells does a ray pass? Exact, in slabs along its dominant axis.

The rules are those of `segments2d.py`, one dimension up: a ray passes a cell if and only if it has
positive length inside it. Along the dominant axis a (b < c are the others) the ray is cut at the
cell borders into slabs. In one slab b and c each move by at most one cell, so a slab holds the cell
of entry, the cell of leaving, and, where both b and c change, the cell between: which one it is
depends on the border that is met first.

Positions at the borders are u_j = u_0 + j * slope in double precision, without a dependency from
slab to slab. They count from the cell border that is nearest to the start point, which loses no bit
of it; from the window's corner, rounding would differ between sides of tiles. An edge counts as
touched when the ray comes within 2^-28 cell of it.

Rays are set up many at a time, in a loop without branches that vectorises (7 ns per ray instead of
22), then listed one by one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import inlined

__all__ = ["COLUMNS", "FIRST", "RAYS", "emit_ray", "put_ray", "ray_axis", "set_up"]

TOUCH = 2.0**-28

RAYS = 64
"""How many rays a table holds. A table is one row of columns of this length: at places that are
known when it is compiled, or the loop over rays would not vectorise."""
X, Y, Z = 0 * RAYS, 1 * RAYS, 2 * RAYS
"""End points [cells]: they and the start points are the input of `set_up`; its results follow."""
X0, Y0, Z0 = 20 * RAYS, 21 * RAYS, 22 * RAYS
"""Start points."""
AXIS = 3 * RAYS
"""The dominant axis a: 0, 1 or 2."""
STEP = 4 * RAYS
"""Direction along a, 1 or -1."""
FIRST = 5 * RAYS
"""Cell of slab 0 along a, in the window."""
BORDERS = 6 * RAYS
"""How many cell borders are crossed along a."""
U = 7 * RAYS
"""Position along b at the first border, from the cell border that is nearest to the start point."""
V = 8 * RAYS
"""Along c."""
ZERO_U = 9 * RAYS
"""Where u is 0 in the window."""
ZERO_V = 10 * RAYS
SLOPE_U = 11 * RAYS
SLOPE_V = 12 * RAYS
HEAD = 13 * RAYS
"""Codes of the three cells of slab 0, where a border follows: three columns."""
TAIL = 16 * RAYS
"""Codes of the three cells of the last slab."""
LISTED = 19 * RAYS
"""1 where there are any, else 0."""
COLUMNS = 23

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@inlined
def _touch(slope: float) -> float:
    # At most half a slab's rise, or a nearly level ray would be moved out of its own cell.
    return np.copysign(min(TOUCH, 0.5 * abs(slope)), slope)


@inlined
def ray_axis(dx: float, dy: float, dz: float) -> int:
    """The dominant axis of a direction: 0, 1 or 2."""
    ax, ay, az = abs(dx), abs(dy), abs(dz)
    if ax >= ay:
        return 0 if ax >= az else 2
    return 1 if ay >= az else 2


@inlined
def _part(cell: float, near: float, block: float, blocks_a_cell: float) -> float:
    # What a cell's place along one axis adds to its code: cells are `near` apart in a block, and
    # `block` more where a new one begins.
    return cell * near + np.floor(cell * blocks_a_cell) * block


@inlined
def put_ray(
    table: FloatArray, ray: np.uint64, origins: FloatArray, bundle: int, ends: FloatArray, i: int
) -> None:
    """Put a ray into a table: from the origin of its bundle to its end [cells]."""
    table[X0 + ray] = origins[bundle, 0]
    table[Y0 + ray] = origins[bundle, 1]
    table[Z0 + ray] = origins[bundle, 2]
    table[X + ray], table[Y + ray], table[Z + ray] = ends[i, 0], ends[i, 1], ends[i, 2]


@inlined
def set_up(lo: IntArray, bits: int, blocks: IntArray, table: FloatArray, count: int) -> None:
    """Describe rays.

    All in double precision, which holds cells and their codes exactly.

    Args:
        lo: first cell of the window, shape (3,); every cell of the rays and one more around it
            lie above.
        bits: log2 of the side of a block.
        blocks: how far apart blocks are along each axis in the window, in blocks, shape (3,).
        table: start and end points are given, see `put_ray`, the other columns are filled, shape
            (COLUMNS * RAYS,).
        count: how many rays, at most RAYS.
    """
    side = float(1 << bits)
    per_cell = 1.0 / side
    cells = float(1 << (3 * bits))
    x_near, y_near, z_near = 1.0, side, side * side
    x_block = float(blocks[0]) * cells - x_near * side
    y_block = float(blocks[1]) * cells - y_near * side
    z_block = float(blocks[2]) * cells - z_near * side
    x_lo, y_lo, z_lo = float(lo[0]), float(lo[1]), float(lo[2])
    for j in range(count):
        ray = np.uint64(j)
        x0, y0, z0 = table[X0 + ray], table[Y0 + ray], table[Z0 + ray]
        x_zero, y_zero, z_zero = np.rint(x0), np.rint(y0), np.rint(z0)
        x_in, y_in, z_in = x_zero - x_lo, y_zero - y_lo, z_zero - z_lo
        x1, y1, z1 = table[X + ray], table[Y + ray], table[Z + ray]
        ax, ay, az = abs(x1 - x0), abs(y1 - y0), abs(z1 - z0)
        by_x = (ax >= ay) & (ax >= az)
        by_z = (az > ax) & (az > ay)
        # Each quantity along a, b and c. (Chosen one by one: a loop over axes does not vectorise.)
        a0 = x0 if by_x else (z0 if by_z else y0)
        a1 = x1 if by_x else (z1 if by_z else y1)
        a_zero = x_zero if by_x else (z_zero if by_z else y_zero)
        a_in = x_in if by_x else (z_in if by_z else y_in)
        a_near = x_near if by_x else (z_near if by_z else y_near)
        a_block = x_block if by_x else (z_block if by_z else y_block)
        b0, b1 = (y0, y1) if by_x else (x0, x1)
        b_zero, b_in = (y_zero, y_in) if by_x else (x_zero, x_in)
        b_near, b_block = (y_near, y_block) if by_x else (x_near, x_block)
        c0, c1 = (y0, y1) if by_z else (z0, z1)
        c_zero, c_in = (y_zero, y_in) if by_z else (z_zero, z_in)
        c_near, c_block = (y_near, y_block) if by_z else (z_near, z_block)

        da, db, dc = a1 - a0, b1 - b0, c1 - c0
        # End cells by the end point's own coordinates: no rounding may move a hit.
        a_end, b_end, c_end = np.floor(a1), np.floor(b1), np.floor(c1)
        # First cells with positive length: a ray that falls from a border begins below it. Last
        # ones: a ray that rises to a border ends below it.
        a_start, b_start, c_start = np.floor(a0), np.floor(b0), np.floor(c0)
        a_start -= 1.0 if (a0 == a_start) & (da < 0.0) else 0.0
        b_start -= 1.0 if (b0 == b_start) & (db < 0.0) else 0.0
        c_start -= 1.0 if (c0 == c_start) & (dc < 0.0) else 0.0
        b_stop = b_end - (1.0 if (b1 == b_end) & (db > 0.0) else 0.0)
        c_stop = c_end - (1.0 if (c1 == c_end) & (dc > 0.0) else 0.0)
        # A ray that rises to a border has no length beyond it.
        beyond = (da < 0.0) | (a1 > a_end)
        a_end, b_end, c_end = a_end - a_zero, b_end - b_zero, c_end - c_zero
        a_start, b_start, c_start = a_start - a_zero, b_start - b_zero, c_start - c_zero
        b_stop, c_stop = b_stop - b_zero, c_stop - c_zero
        a0, b0, c0 = a0 - a_zero, b0 - b_zero, c0 - c_zero
        step = 1.0 if da > 0.0 else -1.0
        n = (a_end - a_start) * step
        to_border = a_start + 1.0 - a0 if da > 0.0 else a0 - a_start
        way = abs(da)
        su, sv = (db / way, dc / way) if way > 0.0 else (0.0, 0.0)
        # A level ray goes through the middle of its cells, wherever rounding has put it.
        u = b0 + to_border * su if db != 0.0 else b_start + 0.5
        v = c0 + to_border * sv if dc != 0.0 else c_start + 0.5
        tu, tv, pu, pv = _touch(su), _touch(sv), abs(su), abs(sv)
        table[AXIS + ray] = 0.0 if by_x else (2.0 if by_z else 1.0)
        table[STEP + ray] = step
        table[FIRST + ray] = a_in + a_start
        table[BORDERS + ray] = n
        table[U + ray], table[V + ray] = u, v
        table[ZERO_U + ray], table[ZERO_V + ray] = b_in, c_in
        table[SLOPE_U + ray], table[SLOPE_V + ray] = su, sv

        # Slab 0, from the start point to the first border.
        lu, lv = np.floor(u - tu), np.floor(v - tv)
        lu = min(lu, b_start) if db < 0.0 else max(lu, b_start)
        lv = min(lv, c_start) if dc < 0.0 else max(lv, c_start)
        near = abs(max(b_start, lu) - b0) * pv
        other = abs(max(c_start, lv) - c0) * pu
        place = _part(a_in + a_start, a_near, a_block, per_cell)
        e_b = _part(b_in + b_start, b_near, b_block, per_cell)
        l_b = _part(b_in + lu, b_near, b_block, per_cell)
        e_c = _part(c_in + c_start, c_near, c_block, per_cell)
        l_c = _part(c_in + lv, c_near, c_block, per_cell)
        m_b = l_b if near < other - TOUCH else e_b
        m_c = l_c if other < near - TOUCH else e_c
        table[HEAD + ray] = place + e_b + e_c
        table[HEAD + RAYS + ray] = place + l_b + l_c
        table[HEAD + 2 * RAYS + ray] = place + m_b + m_c

        # The last slab, from the last border (or the start) to the end point.
        crosses = n > 0.0
        u0 = u + (n - 1.0) * su if crosses else b0
        v0 = v + (n - 1.0) * sv if crosses else c0
        eu = np.floor(u0 + tu) if crosses else b_start
        ev = np.floor(v0 + tv) if crosses else c_start
        eu = max(eu, b_stop) if db < 0.0 else min(eu, b_stop)
        ev = max(ev, c_stop) if dc < 0.0 else min(ev, c_stop)
        near = abs(max(eu, b_stop) - u0) * pv
        other = abs(max(ev, c_stop) - v0) * pu
        place = _part(a_in + a_end, a_near, a_block, per_cell)
        e_b = _part(b_in + eu, b_near, b_block, per_cell)
        l_b = _part(b_in + b_stop, b_near, b_block, per_cell)
        e_c = _part(c_in + ev, c_near, c_block, per_cell)
        l_c = _part(c_in + c_stop, c_near, c_block, per_cell)
        entry, leave = place + e_b + e_c, place + l_b + l_c
        m_b = l_b if near < other - TOUCH else e_b
        m_c = l_c if other < near - TOUCH else e_c
        middle = place + m_b + m_c
        end = place + _part(b_in + b_end, b_near, b_block, per_cell)
        end += _part(c_in + c_end, c_near, c_block, per_cell)
        # The end point's cell is not listed: the entry stands in for it, unless it is that cell
        # itself, and then the ray passes nothing more.
        table[TAIL + ray] = entry
        table[TAIL + RAYS + ray] = entry if leave == end else leave
        table[TAIL + 2 * RAYS + ray] = entry if middle == end else middle
        table[LISTED + ray] = 1.0 if (entry != end) & beyond & (way > 0.0) else 0.0


@inlined
def emit_ray(
    table: FloatArray,
    ray: int,
    skip: int,
    bits: int,
    blocks: IntArray,
    buffer: npt.NDArray[np.signedinteger],
    at: int,
) -> int:
    """List the cells that a ray passes, without the cell of its end point.

    Args:
        table: rays, from `set_up`.
        ray: which one.
        skip: leading slabs that need not be listed.
        bits: log2 of the side of a block.
        blocks: how far apart blocks are along each axis in the window, in blocks, shape (3,).
        buffer: takes the cells' codes, (block << 3 * bits) + place in the block, shape
            (3, at least `at` + slabs + 9): the cells of entry, of leaving and between; any two may
            be the same. Of 32 bits, which is twice as fast, or of 64 for windows past 2^31 cells.
        at: where to write to in the buffer.

    Returns:
        Where the slabs that were written end in the buffer.
    """
    ray = np.uint64(ray)
    n = np.int64(table[BORDERS + ray])
    count = at
    if skip == 0 and n > 0:
        to = np.uint64(at)
        buffer[0, to] = np.int64(table[HEAD + ray])
        buffer[1, to] = np.int64(table[HEAD + RAYS + ray])
        buffer[2, to] = np.int64(table[HEAD + 2 * RAYS + ray])
        count = at + 1

    # Inner slabs, from border to border: this loop vectorises, and is where the time goes.
    a = np.int64(table[AXIS + ray])
    b, c = 1 if a == 0 else 0, 1 if a == 2 else 2
    # A code is a sum of one part an axis: the cell's place and, where a new block begins, more.
    # Factors in 32 bits where codes have 32: a third of the time of a product.
    code = buffer.dtype.type
    a_near, b_near, c_near = code(1 << (bits * a)), code(1 << (bits * b)), code(1 << (bits * c))
    a_block = code((blocks[a] << (3 * bits)) - (1 << (bits * (a + 1))))
    b_block = code((blocks[b] << (3 * bits)) - (1 << (bits * (b + 1))))
    c_block = code((blocks[c] << (3 * bits)) - (1 << (bits * (c + 1))))
    begin = max(1, skip)
    inner = max(0, n - begin)
    falls = -1 if table[STEP + ray] < 0.0 else 0
    column = np.int64(table[FIRST + ray]) + ((begin ^ falls) - falls)
    su, sv = table[SLOPE_U + ray], table[SLOPE_V + ray]
    tu, tv = _touch(su), _touch(sv)
    u, v = table[U + ray], table[V + ray]
    u_entry, v_entry = u + tu, v + tv
    u_leave, v_leave = u + su - tu, v + sv - tv
    u_zero, v_zero = np.int32(table[ZERO_U + ray]), np.int32(table[ZERO_V + ray])
    # Signed so that ways to the border that is met are positive.
    qu, qv = np.copysign(su, sv), np.copysign(sv, su)
    # Rounded up to whole vectors: most rays list a dozen slabs, and a scalar remainder would cost
    # 10 % of a scan. The buffer has room, and the remainder is not counted.
    for k in range((inner + 7) & -8):
        cell = code(column + ((k ^ falls) - falls))
        place = cell * a_near + (cell >> bits) * a_block
        # Not from the first slab that is listed: rounding would depend on what is skipped.
        slab = np.int32(begin - 1 + k)
        u_way, v_way = slab * su, slab * sv
        eu_at, ev_at = np.floor(u_entry + u_way), np.floor(v_entry + v_way)
        lu_at, lv_at = np.floor(u_leave + u_way), np.floor(v_leave + v_way)
        near = (max(eu_at, lu_at) - (u + u_way)) * qv
        other = (max(ev_at, lv_at) - (v + v_way)) * qu
        eu, ev = np.int32(np.int32(eu_at) + u_zero), np.int32(np.int32(ev_at) + v_zero)
        lu, lv = np.int32(np.int32(lu_at) + u_zero), np.int32(np.int32(lv_at) + v_zero)
        e_b = eu * b_near + (eu >> bits) * b_block
        l_b = lu * b_near + (lu >> bits) * b_block
        e_c = ev * c_near + (ev >> bits) * c_block
        l_c = lv * c_near + (lv >> bits) * c_block
        m_b = l_b if near < other - TOUCH else e_b
        m_c = l_c if other < near - TOUCH else e_c
        to = np.uint64(count + k)
        buffer[0, to] = code(place + e_b + e_c)
        buffer[1, to] = code(place + l_b + l_c)
        buffer[2, to] = code(place + m_b + m_c)
    count += inner

    to = np.uint64(count)
    buffer[0, to] = np.int64(table[TAIL + ray])
    buffer[1, to] = np.int64(table[TAIL + RAYS + ray])
    buffer[2, to] = np.int64(table[TAIL + 2 * RAYS + ray])
    return count + np.int64(table[LISTED + ray])
