# SPDX-License-Identifier: Apache-2.0
"""What one beam says near its return: cells it crosses, shares of its hit, fading passes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import kernel
from oddsmap.kernels.units import ONE

__all__ = ["BeamShape", "fade_cells", "walk", "zone_cells"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class BeamShape(NamedTuple):
    """How a beam votes around its return, lengths in cells."""

    share: bool
    """True: the cells of the occupied region share one hit; False: each gets a whole one."""
    half_width: float
    """How far the occupied region reaches before and behind the return."""
    sigma: float
    """Standard deviation of the range, by which a hit is shared; 0: it is shared by length."""
    fade: float
    """The way before the occupied region over which passes fade from 1 to 0."""


@kernel
def walk(start: FloatArray, stop: FloatArray, cells: IntArray, left: FloatArray) -> int:
    """List the cells in which a segment has positive length.

    From border to border (Amanatides and Woo 1987), in double precision.

    Args:
        start: where it begins [cells], shape (d,).
        stop: where it ends, shape (d,); for a segment of no length there is the one cell.
        cells: takes the cells' indices, shape (enough, d).
        left: takes the share of the way at which each cell is left, shape (enough,); the last
            one's is 1.

    Returns:
        How many cells there are.
    """
    d = start.shape[0]
    at = np.empty(d, np.int64)
    last = np.empty(d, np.int64)
    until = np.empty(d, np.float64)  # share of the way at which the next border is met, by axis
    per_cell = np.empty(d, np.float64)
    level = True
    for axis in range(d):
        at[axis] = np.int64(math.floor(start[axis]))
        # An end on a border belongs to the cell before it: the next one is only touched, and a
        # sum rounded to just below 1 must not list it.
        last[axis] = np.int64(
            math.ceil(stop[axis]) - 1.0 if stop[axis] > start[axis] else math.floor(stop[axis])
        )
        way = abs(stop[axis] - start[axis])
        per_cell[axis] = 1.0 / way if way > 0 else np.inf
        ahead_of = at[axis] + 1.0 - start[axis]
        to_border = ahead_of if stop[axis] > start[axis] else start[axis] - at[axis]
        # Not times 1 / way, which is infinite where the way is next to nothing.
        until[axis] = to_border / way if way > 0 else np.inf
        level = level and way == 0
    count, entered = 0, 0.0
    while True:
        ahead = False
        for axis in range(d):
            ahead = ahead or at[axis] != last[axis]
        # The axis whose border comes next, among those that have not arrived: rounding must not
        # carry the walk past its last cell.
        step = -1
        for axis in range(d):
            if at[axis] != last[axis] and (step < 0 or until[axis] < until[step]):
                step = axis
        gone = min(1.0, until[step]) if ahead else 1.0
        if gone > entered or level:
            for axis in range(d):
                cells[count, axis] = at[axis]
            left[count] = gone
            count += 1
        if not ahead:
            return count
        entered = max(entered, gone)
        at[step] += 1 if stop[step] > start[step] else -1
        until[step] += per_cell[step]


@kernel
def zone_cells(
    ends: FloatArray,
    tips: FloatArray,
    i: int,
    shape: BeamShape,
    cells: IntArray,
    left: FloatArray,
    weights: IntArray,
) -> int:
    """List the cells of a beam's occupied region, and each one's share of the hit.

    Args:
        ends: where the region begins [cells], shape (n, d).
        tips: where it ends, shape (n, d); the same point for a region of one cell.
        i: which beam.
        shape: how the hit is shared.
        cells: takes the cells' indices, shape (enough, d).
        left: room, shape (enough,).
        weights: takes their weights [1/65536 vote], shape (enough,).

    Returns:
        How many cells there are.
    """
    way = _distance(ends[i], tips[i])
    if way == 0.0:
        # A region of one cell, as most are: 200 ns less than a walk.
        for axis in range(ends.shape[1]):
            cells[0, axis] = np.int64(math.floor(ends[i, axis]))
        weights[0] = ONE
        return 1
    count = walk(ends[i], tips[i], cells, left)
    assigned = np.int64(0)
    for k in range(count):
        # Differences of a rounded running sum: the shares of one beam add up to ONE exactly.
        total = np.int64(np.rint(_mass_until(left[k], way, shape) * ONE))
        weights[k] = total - assigned if shape.share else ONE
        assigned = total
    return count


@kernel
def _mass_until(gone: float, way: float, shape: BeamShape) -> float:
    # Of the normal distribution around the return, cut off at the region's ends.
    if shape.sigma == 0.0 or gone >= 1.0:
        return gone
    unit = 1.0 / (math.sqrt(2.0) * shape.sigma)
    # The return is half_width before the tip, also where the sensor cuts the region short.
    start = shape.half_width - way
    low, high = math.erf(start * unit), math.erf(shape.half_width * unit)
    return min(1.0, (math.erf((start + gone * way) * unit) - low) / (high - low))


@kernel
def fade_cells(
    origin: FloatArray,
    fades: FloatArray,
    ends: FloatArray,
    i: int,
    fade: float,
    cells: IntArray,
    left: FloatArray,
    weights: IntArray,
) -> int:
    """List the cells in which a beam's passes fade, and what each pass weighs.

    A pass weighs 1 up to `fade` before the end of the free part, and from there falls in a
    straight line to 0 at the end. A cell gets the mean over the beam's free part inside it; the
    end's own cell gets no pass.

    Args:
        origin: the sensor [cells], shape (d,).
        fades: where passes begin to fade, shape (n, d): cells before that one are not listed.
        ends: where the free part ends, shape (n, d).
        i: which beam.
        fade: the way over which passes fade [cells].
        cells: takes the cells' indices, shape (enough, d).
        left: room, shape (enough,).
        weights: takes their weights [1/65536 vote], shape (enough,).

    Returns:
        How many cells there are; 0 where nothing fades.
    """
    start, end = fades[i], ends[i]
    way = _distance(start, end)
    if way == 0.0:
        return 0
    count = walk(start, end, cells, left)
    before = _way_before(origin, start, end, way)
    entered = 0.0
    for k in range(count):
        inside = (left[k] - entered) * way
        mean = min(1.0, (1.0 - 0.5 * (entered + left[k])) * way / fade)
        if _holds(cells[k], start):
            mean = (before + inside * mean) / (before + inside)
        weights[k] = 0 if _holds(cells[k], end) else np.int64(np.rint(mean * ONE))
        entered = left[k]
    if before > 0.0 and not _holds(cells[0], start):
        # The beam comes to the border of the cell in which it begins to fade, and leaves it there.
        for axis in range(start.shape[0]):
            cells[count, axis] = np.int64(math.floor(start[axis]))
        weights[count] = 0 if _holds(cells[count], end) else ONE
        count += 1
    return count


@kernel
def _way_before(origin: FloatArray, start: FloatArray, end: FloatArray, way: float) -> float:
    """How far a beam has come inside the cell of `start` when it is there."""
    before = _distance(origin, start)
    for axis in range(start.shape[0]):
        along = end[axis] - start[axis]
        cell = math.floor(start[axis])
        if along != 0.0:
            back = start[axis] - cell if along > 0.0 else cell + 1.0 - start[axis]
            before = min(before, back * way / abs(along))
    return before


@kernel
def _holds(cell: IntArray, point: FloatArray) -> bool:
    same = True
    for axis in range(point.shape[0]):
        same = same and cell[axis] == np.int64(math.floor(point[axis]))
    return same


@kernel
def _distance(one: FloatArray, other: FloatArray) -> float:
    total = 0.0
    for axis in range(one.shape[0]):
        total += (other[axis] - one[axis]) ** 2
    return math.sqrt(total)
