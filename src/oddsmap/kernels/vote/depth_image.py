# SPDX-License-Identifier: Apache-2.0
"""A depth image into marks: cells are looked up in the image, not the image's rays in cells.

A cell is free if its centre falls on a pixel whose depth lies beyond it by at least half a cell's
diagonal. Cells are asked in boxes first, the window, its eighths and so on down to blocks, each of
which a pyramid of lowest and highest depths may decide at once: all behind, or all free. Hits are
the end cells of the pixels' rays, to the bit those of the ray method.

Whether a cell is free is computed from its index and the pose alone, by the same operations in the
same order, so that no window and no tile size changes a bit. Boxes are decided with a margin wider
than rounding, and so never other than their cells one by one.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined, kernel
from oddsmap.kernels.trace.clip_beams import BODY, HEIGHT
from oddsmap.kernels.trace.readings import BELOW, CLEARS, NAN, NO_RETURN, Limits, judge
from oddsmap.kernels.vote.rays3d import FREE, OCCUPIED

__all__ = ["TEXEL_BITS", "depth_box", "mark_ends", "mark_free", "read_depth"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Image = npt.NDArray[np.float32]
Marks = npt.NDArray[np.uint8]

TEXEL_BITS = 3
"""The pyramid begins with 8 x 8 pixels: blocks seldom cover fewer."""
TEXEL = 1 << TEXEL_BITS

# Projections of a cell's centre, linear in its position: U / Z is the column plus 1/2, V / Z the
# row, Z the depth. The centre is in the image where U >= 0, V >= 0 and the distances to the far
# borders, width * Z - U and height * Z - V, are positive.
U, V, Z, U_LEFT, V_LEFT = range(5)

NONE, SOME, ALL = 0, 1, 2
"""Which cells of a box are free."""

# Boxes are projected with this margin [pixels], for rounding.
PIXEL_MARGIN = 1e-6


@kernel
def read_depth(
    depth: npt.NDArray[np.floating],
    range_per_depth: FloatArray,
    limits: Limits,
    clear: Image,
    seen: npt.NDArray[np.uint8],
    min_clear: npt.NDArray[np.float32],
    max_clear: npt.NDArray[np.float32],
    skipped: IntArray,
) -> int:
    """Sort the pixels of an image into returns, no-returns and the rest, and make a pyramid.

    The rule is `judge`'s, for the distance along the pixel's ray. Returns are found by the same
    comparisons without branches, which the compiler vectorises.

    Args:
        depth: distance along z [m], shape (h, w).
        range_per_depth: distance along the ray at depth 1, shape (h, w).
        limits: see `judge`.
        clear: takes the depth up to which each pixel clears [m], 0: it does not; shape (h, w).
        seen: takes 1 where there is a return, else 0; shape (h, w).
        min_clear: takes the lowest of `clear` in each texel, shape (levels, rows, columns). A texel
            of level k has 8 << k pixels along each side.
        max_clear: likewise the highest.
        skipped: counts by NAN, BELOW, NO_RETURN, added to.

    Returns:
        How many pixels are used.
    """
    range_min, range_max = limits[0], limits[1]
    height, width = depth.shape
    columns = (width + TEXEL - 1) >> TEXEL_BITS
    low, high = np.empty(width, np.float32), np.empty(width, np.float32)
    used = 0
    for v in range(height):
        readings, returns, below = 0, 0, 0
        for u in range(width):
            d = np.float64(depth[v, np.uint64(u)])
            r = d * range_per_depth[v, np.uint64(u)]
            known = (d > 0.0) & (d < np.inf)
            far_enough = known & (r >= range_min)
            hit = far_enough & (r < range_max)
            readings += np.int32(known)
            below += np.int32(known) - np.int32(far_enough)
            returns += np.int32(hit)
            clear[v, np.uint64(u)] = np.float32(d if hit else 0.0)
            seen[v, np.uint64(u)] = np.uint8(hit)
        used += returns
        skipped[NAN] += width - readings
        skipped[BELOW] += below
        if readings - below > returns:
            for u in range(width):
                d = np.float64(depth[v, u])
                r = d * range_per_depth[v, u]
                if seen[v, u] or not 0.0 < d < np.inf:
                    continue
                verdict, reach = judge(r, limits)
                if verdict == NO_RETURN:
                    skipped[NO_RETURN] += 1
                elif verdict == CLEARS:
                    clear[v, u] = np.float32(reach / range_per_depth[v, u])
                    used += 1
        row = clear[v]
        if v & (TEXEL - 1) == 0:
            for u in range(width):
                low[np.uint64(u)] = row[np.uint64(u)]
                high[np.uint64(u)] = row[np.uint64(u)]
        else:
            for u in range(width):
                value = row[np.uint64(u)]
                before, after = low[np.uint64(u)], high[np.uint64(u)]
                low[np.uint64(u)] = value if value < before else before
                high[np.uint64(u)] = value if value > after else after
        if v & (TEXEL - 1) == TEXEL - 1 or v == height - 1:
            for column in range(columns):
                first = column << TEXEL_BITS
                a, b = low[first], high[first]
                for u in range(first + 1, min(first + TEXEL, width)):
                    a, b = min(a, low[u]), max(b, high[u])
                min_clear[0, v >> TEXEL_BITS, column] = a
                max_clear[0, v >> TEXEL_BITS, column] = b
    rows = (height + TEXEL - 1) >> TEXEL_BITS
    for level in range(1, min_clear.shape[0]):
        wide, tall = columns, rows
        columns, rows = (wide + 1) >> 1, (tall + 1) >> 1
        for y in range(rows):
            y0, y1 = 2 * y, min(2 * y + 1, tall - 1)
            for x in range(columns):
                x0, x1 = 2 * x, min(2 * x + 1, wide - 1)
                one, other = min_clear[level - 1, y0], min_clear[level - 1, y1]
                min_clear[level, y, x] = min(one[x0], one[x1], other[x0], other[x1])
                one, other = max_clear[level - 1, y0], max_clear[level - 1, y1]
                max_clear[level, y, x] = max(one[x0], one[x1], other[x0], other[x1])
    return used


@borrowing
def depth_box(
    max_clear: npt.NDArray[np.float32],
    intrinsics: tuple[float, float, float, float],
    size: tuple[int, int],
    rotation: FloatArray,
    block: float,
    lo: FloatArray,
    hi: FloatArray,
) -> float:
    """Widen a box by all that an image may free or hit, up to the borders of its outer pixels.

    Args:
        max_clear: from `read_depth`.
        intrinsics: fx, fy, cx, cy.
        size: width and height of the image.
        rotation: map_from_sensor, shape (3, 3).
        block: side of a block [m].
        lo: lowest corner, relative to the camera in the axes of the map [m], shape (3,).
        hi: highest corner.

    Returns:
        A bound of how many blocks are touched: each texel's pyramid in a box along it.
    """
    touched = 0.0
    fx, fy, cx, cy = intrinsics
    width, height = size
    for row in range((height + TEXEL - 1) >> TEXEL_BITS):
        y0 = ((row << TEXEL_BITS) - 0.5 - cy) / fy
        y1 = (min((row + 1) << TEXEL_BITS, height) - 0.5 - cy) / fy
        for column in range((width + TEXEL - 1) >> TEXEL_BITS):
            depth = np.float64(max_clear[0, row, column])
            if depth == 0.0:
                continue
            x0 = ((column << TEXEL_BITS) - 0.5 - cx) / fx
            x1 = (min((column + 1) << TEXEL_BITS, width) - 0.5 - cx) / fx
            deep = depth * math.sqrt(1.0 + max(x0 * x0, x1 * x1) + max(y0 * y0, y1 * y1)) / block
            wide, high = depth * abs(x1 - x0) / block, depth * abs(y1 - y0) / block
            touched += (deep + 2.0) * (wide + 2.0) * (high + 2.0)
            for axis in range(3):
                rx, ry, rz = rotation[axis, 0], rotation[axis, 1], rotation[axis, 2]
                across = min(rx * x0, rx * x1) + min(ry * y0, ry * y1) + rz
                lo[axis] = min(lo[axis], depth * across)
                across = max(rx * x0, rx * x1) + max(ry * y0, ry * y1) + rz
                hi[axis] = max(hi[axis], depth * across)
    return touched


@inlined
def _peak(places: FloatArray, what: int, x0: int, x1: int, y0: int, y1: int, z0: int, z1: int):  # type: ignore[no-untyped-def]
    # The maximum of a linear function over a box of cells.
    across = max(places[what, 0, x0], places[what, 0, x1])
    across += max(places[what, 1, y0], places[what, 1, y1])
    return across + max(places[what, 2, z0], places[what, 2, z1])


@inlined
def _resolve(
    places: FloatArray,
    slack: FloatArray,
    half: float,
    size: tuple[int, int],
    min_clear: npt.NDArray[np.float32],
    max_clear: npt.NDArray[np.float32],
    first: tuple[int, int, int],
    last: tuple[int, int, int],
) -> int:
    # Which cells of a box, given by its first and last cell, are free, as far as that is easy to
    # tell: SOME stands for "ask further".
    x0, y0, z0 = first
    x1, y1, z1 = last
    answer = SOME
    for what in range(5):
        if _peak(places, what, x0, x1, y0, y1, z0, z1) < -slack[what]:
            answer = NONE
    z_min = min(places[Z, 0, x0], places[Z, 0, x1]) + min(places[Z, 1, y0], places[Z, 1, y1])
    z_min += min(places[Z, 2, z0], places[Z, 2, z1])
    # Nearer to the camera's plane, rounding would move projections by more than the margin.
    if answer == SOME and z_min * PIXEL_MARGIN > max(slack[U], slack[V], slack[Z]):
        u_lo, u_hi, v_lo, v_hi = np.inf, -np.inf, np.inf, -np.inf
        for corner in range(8):
            x = np.uint64(x1 if corner & 1 else x0)
            y = np.uint64(y1 if corner & 2 else y0)
            z = np.uint64(z1 if corner & 4 else z0)
            scale = 1.0 / (places[Z, 0, x] + places[Z, 1, y] + places[Z, 2, z])
            u = (places[U, 0, x] + places[U, 1, y] + places[U, 2, z]) * scale
            v = (places[V, 0, x] + places[V, 1, y] + places[V, 2, z]) * scale
            u_lo, u_hi = min(u_lo, u), max(u_hi, u)
            v_lo, v_hi = min(v_lo, v), max(v_hi, v)
        width, height = size
        u_lo, u_hi, v_lo, v_hi = (
            u_lo - PIXEL_MARGIN, u_hi + PIXEL_MARGIN, v_lo - PIXEL_MARGIN, v_hi + PIXEL_MARGIN
        )  # fmt: skip
        whole = (u_lo >= 0.0) & (u_hi < width) & (v_lo >= 0.0) & (v_hi < height)
        left, right = np.int64(max(u_lo, 0.0)), np.int64(min(u_hi, width - 1.0))
        top, bottom = np.int64(max(v_lo, 0.0)), np.int64(min(v_hi, height - 1.0))
        if left <= right and top <= bottom:
            # Up to 4 texels per side.
            level = TEXEL_BITS
            across = max(right - left, bottom - top)
            while across >> level > 2:
                level += 1
            at = level - TEXEL_BITS
            low, high = np.float32(np.inf), np.float32(0.0)
            for y in range(top >> level, (bottom >> level) + 1):
                for x in range(left >> level, (right >> level) + 1):
                    low = min(low, min_clear[at, y, x])
                    high = max(high, max_clear[at, y, x])
            z_max = _peak(places, Z, x0, x1, y0, y1, z0, z1)
            if z_min + half > high + slack[Z]:
                answer = NONE
            elif whole and z_max + half < low - slack[Z]:
                answer = ALL
    return answer


@kernel
def mark_free(
    places: FloatArray,
    slack: FloatArray,
    half: float,
    clear: Image,
    min_clear: npt.NDArray[np.float32],
    max_clear: npt.NDArray[np.float32],
    bits: int,
    shape: IntArray,
    table: npt.NDArray[np.int32],
    used: IntArray,
    marks: Marks,
) -> bool:
    """Mark the cells of a window whose centre lies before the surface in its pixel.

    Args:
        places: projections of the cells of the window, a sum of one part for each axis: shape
            (5, 3, cells along the longest axis), see U, V, Z, U_LEFT, V_LEFT.
        slack: bounds the rounding of a sum of such parts, shape (5,).
        half: half of a cell's diagonal [m].
        clear: from `read_depth`.
        min_clear: from `read_depth`.
        max_clear: from `read_depth`.
        bits: log2 of the side of a block.
        shape: blocks of the window along each axis.
        table: see `rays3d.mark_passes`.
        used: likewise.
        marks: likewise.

    Returns:
        False where `used` and `marks` have no room: to be called again once they have.
    """
    height, width = clear.shape
    pixels = clear.reshape(height * width)
    side, cells = 1 << bits, 1 << (3 * bits)
    layer = side * side
    flat = np.empty((5, layer))
    flat_u, flat_v, flat_z, flat_a, flat_b = flat[U], flat[V], flat[Z], flat[U_LEFT], flat[V_LEFT]
    last_u, last_v = width - 1.0, height - 1.0
    room = used.shape[0] - 1
    nx, ny, nz = shape[0], shape[1], shape[2]
    level = 0
    while (1 << level) < max(nx, ny, nz):
        level += 1
    # Boxes that are still to be asked: first block along x, y, z and log2 of blocks along a side.
    waiting = np.empty((8 * (level + 1), 4), np.int64)
    waiting[0, :3] = 0
    waiting[0, 3] = level
    count = 1
    while count > 0:
        count -= 1
        bx, by, bz = waiting[count, 0], waiting[count, 1], waiting[count, 2]
        level = waiting[count, 3]
        span = 1 << level
        first = (bx << bits, by << bits, bz << bits)
        last = (
            (min(bx + span, nx) << bits) - 1,
            (min(by + span, ny) << bits) - 1,
            (min(bz + span, nz) << bits) - 1,
        )
        free = _resolve(places, slack, half, (width, height), min_clear, max_clear, first, last)
        if free == NONE:
            continue
        if level > 0:
            span >>= 1
            for part in range(8):
                x, y, z = (
                    bx + span * (part & 1),
                    by + span * (part >> 1 & 1),
                    bz + span * (part >> 2),
                )
                if x < nx and y < ny and z < nz:
                    waiting[count, 0], waiting[count, 1], waiting[count, 2] = x, y, z
                    waiting[count, 3] = level - 1
                    count += 1
            continue
        block = bx + nx * (by + ny * bz)
        slot = np.int64(table[block])
        if slot == 0:
            slot = used[0] + 1
            if slot > room:
                return False
        start = slot * cells
        if free == ALL:
            for k in range(cells):
                marks[np.uint64(start + k)] = FREE
            found = 1
        else:
            # One layer's sums over x and y serve all layers of the block.
            for what in range(5):
                for j in range(side):
                    part_y = places[what, 1, first[1] + j]
                    for i in range(side):
                        flat[what, np.uint64((j << bits) + i)] = (
                            places[what, 0, np.uint64(first[0] + i)] + part_y
                        )
            found = 0
            for k in range(side):
                z = first[2] + k
                add_u, add_v, add_z = places[U, 2, z], places[V, 2, z], places[Z, 2, z]
                add_a, add_b = places[U_LEFT, 2, z], places[V_LEFT, 2, z]
                to = start + k * layer
                for i in range(layer):
                    n = np.uint64(i)
                    pu, pv, depth = flat_u[n] + add_u, flat_v[n] + add_v, flat_z[n] + add_z
                    inside = (pu >= 0.0) & (flat_a[n] + add_a > 0.0)
                    inside &= (pv >= 0.0) & (flat_b[n] + add_b > 0.0)
                    scale = 1.0 / depth
                    pu, pv = pu * scale, pv * scale
                    # Written so that no number, where depth is 0, becomes one.
                    pu = pu if pu < last_u else last_u
                    pv = pv if pv < last_v else last_v
                    pu = pu if pu > 0.0 else 0.0
                    pv = pv if pv > 0.0 else 0.0
                    pixel = np.int32(pv) * np.int32(width) + np.int32(pu)
                    mark = inside & (depth + half < np.float64(pixels[np.uint32(pixel)]))
                    marks[np.uint64(to + i)] = np.uint8(mark)
                    found |= np.int32(mark)
        if found and table[block] == 0:
            used[0] = slot
            used[slot] = block
            table[block] = np.int32(slot)
    return True


@inlined
def _part(cell: int, bits: int, mask: int, far: int, near: int) -> int:
    return (cell >> bits) * far + (cell & mask) * near


@kernel
def mark_ends(
    depth: npt.NDArray[np.floating],
    seen: npt.NDArray[np.uint8],
    x_of: FloatArray,
    y_of: FloatArray,
    rotation: FloatArray,
    origin: FloatArray,
    resolution: float,
    heights: tuple[float, float],
    body: FloatArray,
    lo: IntArray,
    bits: int,
    strides: IntArray,
    margin: float,
    codes: npt.NDArray[np.signedinteger],
    table: npt.NDArray[np.int32],
    used: IntArray,
    marks: Marks,
    skipped: IntArray,
    first: int,
) -> int:
    """Mark the end cells of the pixels with a return, to the bit those of the ray method.

    Cells are first computed by multiplication (1 ns per pixel). Where that comes near a border of
    cells, it is done again by the operations of `cut_beams` and `cell_bounds`, with three divisions
    (20 ns).

    Args:
        depth: distance along z [m], shape (h, w).
        seen: from `read_depth`.
        x_of: x at depth 1 of each column, shape (w,).
        y_of: y at depth 1 of each row, shape (h,).
        rotation: map_from_sensor, shape (3, 3).
        origin: of the camera in the map [m], shape (3,).
        resolution: side of a cell [m].
        heights: see `cut_beams`.
        body: see `cut_beams`.
        lo: first cell of the window.
        bits: log2 of the side of a block.
        strides: blocks between neighbours along each axis.
        margin: how near to a border rounding may decide [cells]; 1: every pixel is done exactly.
        codes: room for a row of cells, 32 or 64 bits each, see `emit_ray`; shape (w,).
        table: see `rays3d.mark_passes`.
        used: likewise.
        marks: likewise.
        skipped: counts by HEIGHT, BODY, added to.
        first: row to go on with; 0 at the first call.

    Returns:
        The row to go on with once there is room for more blocks in `used` and `marks`; -1: done.
    """
    height, width = depth.shape
    room = used.shape[0] - 1
    shift = np.uint64(3 * bits)
    within = (np.uint64(1) << shift) - np.uint64(1)
    xx, xy, xz = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    yx, yy, yz = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    zx, zy, zz = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    ox, oy, oz = origin[0], origin[1], origin[2]
    x_from, y_from, z_from = (
        ox / resolution - lo[0],
        oy / resolution - lo[1],
        oz / resolution - lo[2],
    )
    per_x = x_of * (xx / resolution)
    per_y = x_of * (yx / resolution)
    per_z = x_of * (zx / resolution)
    to_code = codes.dtype.type
    bits32, mask32 = np.int32(bits), np.int32((1 << bits) - 1)
    far_x, far_y = to_code(strides[0] << (3 * bits)), to_code(strides[1] << (3 * bits))
    far_z = to_code(strides[2] << (3 * bits))
    near_x, near_y, near_z = np.int32(1), np.int32(1 << bits), np.int32(1 << (2 * bits))
    beyond = 1.0 - margin
    for v in range(first, height):
        if used[0] + width > room:
            return v
        y = y_of[v]
        row_x = (xy * y + xz) / resolution
        row_y = (yy * y + yz) / resolution
        row_z = (zy * y + zz) / resolution
        for u in range(width):
            n = np.uint64(u)
            hit = seen[v, n] != 0
            d = np.float64(depth[v, n]) if hit else 0.0
            px = x_from + d * (per_x[n] + row_x)
            py = y_from + d * (per_y[n] + row_y)
            pz = z_from + d * (per_z[n] + row_z)
            ix, iy, iz = np.int32(px), np.int32(py), np.int32(pz)
            rest_x, rest_y, rest_z = px - ix, py - iy, pz - iz
            doubt = (rest_x < margin) | (rest_x > beyond) | (rest_y < margin) | (rest_y > beyond)
            doubt |= (rest_z < margin) | (rest_z > beyond)
            code = _part(ix, bits32, mask32, far_x, near_x)
            code += _part(iy, bits32, mask32, far_y, near_y)
            code += _part(iz, bits32, mask32, far_z, near_z)
            code = to_code(-2) if doubt else to_code(code)
            codes[n] = code if hit else to_code(-1)
        for u in range(width):
            code = np.int64(codes[np.uint64(u)])
            if code < 0:
                if code == -1:
                    continue
                bz = np.float64(depth[v, u])
                bx, by = x_of[u] * bz, y * bz
                z = oz + (zx * bx + zy * by + zz * bz)
                if (
                    body[0, 0] <= bx <= body[1, 0]
                    and body[0, 1] <= by <= body[1, 1]
                    and body[0, 2] <= bz <= body[1, 2]
                ):
                    skipped[BODY] += 1
                    continue
                if z < heights[0] or z > heights[1]:
                    skipped[HEIGHT] += 1
                    continue
                x, y_end = ox + (xx * bx + xy * by + xz * bz), oy + (yx * bx + yy * by + yz * bz)
                ix = np.int64(math.floor(x / resolution)) - lo[0]
                iy = np.int64(math.floor(y_end / resolution)) - lo[1]
                iz = np.int64(math.floor(z / resolution)) - lo[2]
                code = _part(ix, bits, mask32, far_x, near_x)
                code += _part(iy, bits, mask32, far_y, near_y)
                code += _part(iz, bits, mask32, far_z, near_z)
            cell = np.uint64(code)
            block = cell >> shift
            slot = np.uint64(table[block])
            if slot == 0:
                used[0] += 1
                slot = np.uint64(used[0])
                table[block] = np.int32(slot)
                used[slot] = np.int64(block)
            marks[(slot << shift) + (cell & within)] = OCCUPIED
    return -1
