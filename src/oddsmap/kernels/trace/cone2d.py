# SPDX-License-Identifier: Apache-2.0
"""The cells of one 2D cone, exactly.

Seen from the sensor a cell spans an interval of angles, between two of its corners; the fraction
is how much of it overlaps the cone's interval. A wedge cuts each row of cells in one interval of
columns, so no cell outside the cone is looked at.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import kernel

__all__ = ["plane_cells"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@kernel
def plane_cells(
    origin: FloatArray,
    axis: FloatArray,
    half_angle: float,
    bin_width: float,
    bias: float,
    reach: float,
    lo: IntArray,
    shape: IntArray,
    limit: int,
    cells: IntArray,
    bins: npt.NDArray[np.int32],
    fractions: FloatArray,
) -> int:
    """List the cells of one beam row by row; arguments as in `cone_cells.list_cells`.

    Returns:
        How many there are; -1 where they are more than `limit`.
    """
    px, py, ax, ay = origin[0], origin[1], axis[0], axis[1]
    s, c = math.sin(half_angle), math.cos(half_angle)
    # Sides of the cone: the axis turned clockwise and anticlockwise.
    rx, ry = c * ax + s * ay, c * ay - s * ax
    lx, ly = c * ax - s * ay, c * ay + s * ax
    far = reach - bias
    own_x, own_y = math.floor(px), math.floor(py)
    # A cell may be near enough and meet the cone a diagonal further on.
    rim = far + 1.5
    low = -far if -ay >= c else max(-far, min(0.0, rim * ry, rim * ly))
    high = far if ay >= c else min(far, max(0.0, rim * ry, rim * ly))
    row_first = max(math.floor(py + low), lo[1])
    row_last = min(math.floor(py + high), lo[1] + shape[1] - 1)
    count = 0
    for row in range(row_first, row_last + 1):
        ya, yb = row - py, row + 1 - py
        dy = max(ya, -yb, 0.0)
        if dy > far:
            continue
        side_y = 1 if ya >= 0.0 else (-1 if yb <= 0.0 else 0)
        x_min, x_max = _wedge_in_strip(ya, yb, rx, ry, lx, ly, ax, c)
        if x_min > x_max:
            continue
        # Columns may still be left where now x_min > x_max: how near a cell is goes by its nearest
        # point, which may lie outside the cone.
        half = math.sqrt(far * far - dy * dy)
        x_min, x_max = min(max(x_min, -half), rim), max(min(x_max, half), -rim)
        column_first = max(math.floor(px + x_min), lo[0])
        column_last = min(math.floor(px + x_max), lo[0] + shape[0] - 1)
        start = (row - lo[1]) * shape[0] - lo[0]
        for column in range(column_first, column_last + 1):
            xa, xb = column - px, column + 1 - px
            side_x = 1 if xa >= 0.0 else (-1 if xb <= 0.0 else 0)
            if (side_x == 0 and side_y == 0) or (column == own_x and row == own_y):
                continue
            dx = max(xa, -xb, 0.0)
            distance = math.sqrt(dx * dx + dy * dy)
            if distance > far:
                continue
            # The two corners between which the cell is seen, anticlockwise.
            ux = xa if side_y < 0 or (side_y == 0 and side_x > 0) else xb
            uy = ya if side_x > 0 or (side_x == 0 and side_y > 0) else yb
            vx = xa if side_y > 0 or (side_y == 0 and side_x > 0) else xb
            vy = yb if side_x > 0 or (side_x == 0 and side_y < 0) else ya
            if (
                rx * uy >= ry * ux
                and lx * uy <= ly * ux
                and rx * vy >= ry * vx
                and lx * vy <= ly * vx
            ):
                fraction = 1.0  # wholly inside: no angles needed, and most cells are
            else:
                fraction = _overlap(
                    math.atan2(ax * uy - ay * ux, ax * ux + ay * uy),
                    math.atan2(ax * vy - ay * vx, ax * vx + ay * vy),
                    half_angle,
                )
                if fraction < 1e-6:
                    continue  # met by no more than rounding
            if count == limit:
                return -1
            cells[count] = start + column
            bins[count] = int(max(0.0, distance + bias) / bin_width)
            fractions[count] = fraction
            count += 1
    return count


@kernel
def _wedge_in_strip(
    ya: float,
    yb: float,
    rx: float,
    ry: float,
    lx: float,
    ly: float,
    ax: float,
    c: float,
) -> tuple[float, float]:
    # Lowest and highest x of the wedge between its sides r and l within ya <= y <= yb. A wedge of
    # up to 180 degrees is convex, so its part in a strip begins and ends on a side, at the apex, or
    # nowhere: c is the cosine of half its angle, and the x axis itself may lie in it.
    x_min, x_max = np.inf, -np.inf
    if ya <= 0.0 <= yb:
        x_min, x_max = 0.0, 0.0
    for ex, ey in ((rx, ry), (lx, ly)):
        for y in (ya, yb):
            if ey * y > 0.0:
                x = y / ey * ex
                x_min, x_max = min(x_min, x), max(x_max, x)
    # A little more than c: too wide an interval costs a few looks, too narrow a one cells.
    if ax >= c - 1e-12:
        x_max = np.inf
    if -ax >= c - 1e-12:
        x_min = -np.inf
    return x_min, x_max


@kernel
def _overlap(begin: float, end: float, half_angle: float) -> float:
    # Share of the cone [-half_angle, half_angle] and of the cell [begin, end], anticlockwise from
    # begin in (-pi, pi], relative to the narrower of the two.
    if end < begin:
        end += 2.0 * math.pi
    turn = 2.0 * math.pi
    both = max(0.0, min(end, half_angle) - max(begin, -half_angle))
    both += max(0.0, min(end, turn + half_angle) - max(begin, turn - half_angle))
    return min(1.0, both / min(end - begin, 2.0 * half_angle))
