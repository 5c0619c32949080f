# SPDX-License-Identifier: Apache-2.0
"""Which 2D cells does a segment pass? Exact, in slabs along its dominant axis.

Cells are half-open squares of side 1. A segment passes a cell if and only if it has positive
length inside it; corners and borders that are only touched do not count, and the cell of its end
point is left to the caller, who gives it the hit.

Along the dominant ("major") axis the segment is cut at the cell borders into slabs 0..n, numbered
from the start. Inside one slab the other ("minor") coordinate moves by at most one cell, so a slab
holds one or two cells. Y_j, the minor coordinate at border j, is Y_0 + j * slope in fixed point
with 40 fractional bits: exact enough for 2^22 cells (error below 2^-18 cell), and without a
dependency from one slab to the next, so the loop vectorises.

A corner counts as touched when the segment comes within 2^-28 cell of it: then ties that are exact
in real numbers stay ties after rounding.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import inlined

__all__ = ["COLUMNS", "emit_passes", "saturated_slabs", "set_up"]

BITS = 40
UNIT = 1 << BITS
TOUCH = 1 << 12

# Columns of the per-segment table that `set_up` fills.
MAJOR = 0
"""0 where x is the major axis, 1 where y is."""
STEP = 1
"""Direction along the major axis, +1 or -1."""
FIRST = 2
"""Major index of slab 0."""
BORDERS = 3
"""How many cell borders are crossed along the major axis: n."""
Y_0 = 4
SLOPE = 5
RISES = 6
"""1 where the minor coordinate grows, -1 where it falls, 0 where it rests."""
MINOR_START = 7
"""Minor index of the first cell with positive length."""
MINOR_STOP = 8
"""Minor index of the last cell with positive length, if the last slab has any."""
MINOR_END = 9
"""Minor index of the end point's cell."""
TAIL = 10
"""1 where the last slab has positive length, else 0."""
COLUMNS = 11

Table = npt.NDArray[np.int64]


@inlined
def set_up(ox: float, oy: float, ex: float, ey: float, table: Table, i: int) -> None:
    """Describe the segment from (ox, oy) to (ex, ey) [cells] in row i of the table.

    Indices are relative to the cell of the start point.
    """
    x_major = abs(ex - ox) >= abs(ey - oy)
    if x_major:
        a0, b0, a1, b1 = ox, oy, ex, ey
    else:
        a0, b0, a1, b1 = oy, ox, ey, ex
    a_cell, b_cell = math.floor(a0), math.floor(b0)
    da, db = a1 - a0, b1 - b0
    table[i, MAJOR] = 0 if x_major else 1
    end_major = np.int64(math.floor(a1) - a_cell)
    table[i, MINOR_END] = np.int64(math.floor(b1) - b_cell)
    if da >= 0:
        table[i, STEP] = 1
        table[i, FIRST] = 0
        table[i, BORDERS] = end_major
        to_border = (a_cell + 1.0) - a0
        table[i, TAIL] = 1 if a1 > math.floor(a1) else 0
    else:
        first = math.ceil(a0) - 1.0
        table[i, STEP] = -1
        table[i, FIRST] = np.int64(first - a_cell)
        table[i, BORDERS] = table[i, FIRST] - end_major
        to_border = a0 - first
        table[i, TAIL] = 1
    slope = db / abs(da) if da != 0 else 0.0
    table[i, Y_0] = np.int64(np.rint(((b0 - b_cell) + to_border * slope) * UNIT))
    # Even, so that half of it is exact: see `_touch`.
    table[i, SLOPE] = 2 * np.int64(np.rint(slope * (UNIT // 2)))
    if db == 0:
        table[i, Y_0] = UNIT // 2  # level: anywhere in its own cell, never rounded out of it
    table[i, MINOR_START] = 0
    table[i, MINOR_STOP] = table[i, MINOR_END]
    if db > 0:
        table[i, RISES] = 1
        table[i, MINOR_STOP] = np.int64(math.ceil(b1) - 1.0 - b_cell)
    elif db < 0:
        table[i, RISES] = -1
        table[i, MINOR_START] = np.int64(math.ceil(b0) - 1.0 - b_cell)
    else:
        table[i, RISES] = 0
    if da == 0:
        table[i, TAIL] = 0


@inlined
def _touch(slope: int) -> int:
    # At most half a slab's rise, or a nearly level segment would be moved out of its own cell.
    return min(TOUCH, abs(slope) >> 1)


@inlined
def saturated_slabs(table: Table, i: int, one: int, other: int) -> int:
    """How many inner slabs of a segment were marked by two others from the same start point.

    Where the segment's slope lies between those of `one` and `other`, its cells lie between
    theirs; while the two are less than a cell apart there is no room for a third cell, so all of
    them are marked. This follows from monotony in exact integers: skipping changes no bit.
    """
    same_fan = (
        table[i, MAJOR] == table[one, MAJOR] == table[other, MAJOR]
        and table[i, STEP] == table[one, STEP] == table[other, STEP]
        and (
            (table[i, RISES] >= 0 and table[one, RISES] >= 0 and table[other, RISES] >= 0)
            or (table[i, RISES] <= 0 and table[one, RISES] <= 0 and table[other, RISES] <= 0)
        )
    )
    between = min(table[one, SLOPE], table[other, SLOPE]) <= table[i, SLOPE] <= max(
        table[one, SLOPE], table[other, SLOPE]
    ) and min(table[one, Y_0], table[other, Y_0]) <= table[i, Y_0] <= max(
        table[one, Y_0], table[other, Y_0]
    )
    if not (same_fan and between):
        return 0
    reach = min(table[i, BORDERS], table[one, BORDERS], table[other, BORDERS]) - 1
    room = UNIT - 1 - abs(table[one, Y_0] - table[other, Y_0])
    room -= abs(_touch(table[one, SLOPE]) - _touch(table[other, SLOPE]))
    if room < 0 or reach <= 0:
        return 0
    spread = abs(table[one, SLOPE] - table[other, SLOPE])
    if spread == 0:
        return reach
    return min(reach, 1 + room // spread)


@inlined
def _inner_range(table: Table, i: int, skip: int, box: Table) -> tuple[int, int]:
    # Slabs first..last (inclusive) among the inner ones that can reach the window.
    first, last = 1 + skip, table[i, BORDERS] - 1
    lo, hi = (box[0], box[1]) if table[i, MAJOR] == 0 else (box[2], box[3])
    if table[i, STEP] > 0:
        first = max(first, lo - table[i, FIRST])
        last = min(last, hi - 1 - table[i, FIRST])
    else:
        first = max(first, table[i, FIRST] - (hi - 1))
        last = min(last, table[i, FIRST] - lo)
    # The minor coordinate is monotone: cut off the slabs on the wrong side of the window. Where one
    # of a slab's two cells lies outside, it lies in the window's margin.
    lo, hi = (box[2], box[3]) if table[i, MAJOR] == 0 else (box[0], box[1])
    y, slope = table[i, Y_0], table[i, SLOPE]
    if slope > 0:
        first = max(first, (lo * UNIT - y) // slope + 1)
        last = min(last, (hi * UNIT - 1 - y) // slope + 1)
    elif slope < 0:
        first = max(first, (y - hi * UNIT) // -slope + 1)
        last = min(last, (y - lo * UNIT - 1) // -slope + 1)
    elif y < lo * UNIT or y >= hi * UNIT:
        last = first - 1
    return first, last


@inlined
def emit_passes(
    table: Table,
    i: int,
    skip: int,
    box: Table,
    clipped: bool,
    stride: int,
    buffer: npt.NDArray[np.int32],
    at: int,
) -> int:
    """List the cells that a segment passes, without the cell of its end point.

    Args:
        table: the segments of a scan, from `set_up`.
        i: which one.
        skip: inner slabs that need not be listed, from `saturated_slabs`.
        box: window x_lo, x_hi, y_lo, y_hi [cells, relative to the start cell, half-open].
        clipped: True where the segment may leave the window.
        stride: cells in one row of the window, its margin of one cell at either side included.
        buffer: takes the slabs' cells as offsets into the window, shape (2, at least `at` +
            borders + 10): the two cells of a slab, or one cell twice.
        at: where to write to in the buffer.

    Returns:
        Where the slabs that were written end in the buffer.
    """
    zero = (1 - box[2]) * stride + (1 - box[0])
    if table[i, MAJOR] == 0:
        along, across = table[i, STEP], stride
        base = zero + table[i, FIRST]
    else:
        along, across = table[i, STEP] * stride, 1
        base = zero + table[i, FIRST] * stride
    n, y, slope = table[i, BORDERS], table[i, Y_0], table[i, SLOPE]
    touch = _touch(slope)
    start, stop, end = table[i, MINOR_START], table[i, MINOR_STOP], table[i, MINOR_END]
    falls = table[i, RISES] < 0
    lower, upper = (touch, -touch) if slope >= 0 else (-touch, touch)

    # Slab 0: from the start point to the first border, or to the end point. The two ends of a
    # segment are computed without branches that beams would take at random (17 ns per beam).
    leave = (y + upper) >> BITS
    other = min(start, leave) if falls else max(start, leave)
    keep = 1
    if n == 0:
        entry = max(start, stop) if falls else min(start, stop)
        other = entry
        keep = table[i, TAIL] if entry != end else 0
    if clipped:
        keep *= _in_window(table, i, 0, start, other, box)
    if n == 0:
        start = other
    to = np.uint64(at)
    buffer[0, to] = np.int32(base + start * across)
    buffer[1, to] = np.int32(base + other * across)
    count = at + keep

    # Inner slabs, each from border to border.
    first, last = 1 + skip, n - 1
    if clipped:
        first, last = _inner_range(table, i, skip, box)
    inner = max(0, last + 1 - first)
    # Two runs of contiguous stores at unsigned indices: this loop vectorises, and it is where
    # mapping spends its time. Rounded up to whole vectors: a scalar remainder would cost 10 ns per
    # beam.
    # The buffer has room, and the remainder is not counted.
    place = base + first * along
    entry_y = y + (first - 1) * slope + lower
    leave_y = y + first * slope + upper
    # Sums, not products with k, and factors of 32 bits: products of 64 bits take three times as
    # long (30 of the 80 ns of a beam).
    per_row = np.int32(across)
    for k in range((inner + 7) & -8):
        to = np.uint64(count + k)
        buffer[0, to] = np.int32(place + (entry_y >> BITS) * per_row)
        buffer[1, to] = np.int32(place + (leave_y >> BITS) * per_row)
        place += along
        entry_y += slope
        leave_y += slope
    count += inner

    # Last slab: from the last border to the end point, without the end point's cell. At most one
    # cell remains, because the minor coordinate moves by at most one cell in a slab.
    entry = (y + (n - 1) * slope + lower) >> BITS
    entry = max(entry, stop) if falls else min(entry, stop)
    keep = table[i, TAIL] if n > 0 and entry != end else 0
    if clipped:
        keep *= _in_window(table, i, n, entry, entry, box)
    buffer[0, np.uint64(count)] = np.int32(base + n * along + entry * across)
    buffer[1, np.uint64(count)] = np.int32(base + n * along + entry * across)
    return count + keep


@inlined
def _in_window(table: Table, i: int, slab: int, one: int, other: int, box: Table) -> int:
    # 1 where a slab with these two cells reaches the window, else 0.
    major = table[i, FIRST] + table[i, STEP] * slab
    if table[i, MAJOR] == 0:
        lo, hi, low, high = box[0], box[1], box[2], box[3]
    else:
        lo, hi, low, high = box[2], box[3], box[0], box[1]
    return 1 if lo <= major < hi and max(one, other) >= low and min(one, other) < high else 0
