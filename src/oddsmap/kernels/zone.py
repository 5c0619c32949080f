# SPDX-License-Identifier: Apache-2.0
"""The occupied region of one beam: which cells it lies in, and each one's share of the hit."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import kernel
from oddsmap.kernels.tiles import ONE

__all__ = ["zone_cells"]


@kernel
def zone_cells(
    ends: npt.NDArray[np.float64],
    tips: npt.NDArray[np.float64],
    i: int,
    share: bool,
    cells: npt.NDArray[np.int64],
    weights: npt.NDArray[np.int64],
) -> int:
    """List the cells in which a beam's occupied region has positive length.

    The way is short (the depth resolution of the sensor), so it is gone in plain steps from border
    to border (Amanatides and Woo 1987), in double precision.

    Args:
        ends: where the region begins [cells], shape (n, d).
        tips: where it ends, shape (n, d); the same point for a region of one cell.
        i: which beam.
        share: True: the cells share one hit by length; False: each gets a whole one.
        cells: takes the cells' indices, shape (enough, d).
        weights: takes their weights [1/65536 vote], shape (enough,).

    Returns:
        How many cells there are.
    """
    d = ends.shape[1]
    at = np.empty(d, np.int64)
    last = np.empty(d, np.int64)
    until = np.empty(d, np.float64)  # share of the way at which the next border is met, by axis
    per_cell = np.empty(d, np.float64)
    level = True
    for axis in range(d):
        start, stop = ends[i, axis], tips[i, axis]
        at[axis] = np.int64(math.floor(start))
        # A tip on a border belongs to the cell before it: the next one is only touched, and a sum
        # rounded to just below 1 must not give it a hit.
        last[axis] = np.int64(math.ceil(stop) - 1.0 if stop > start else math.floor(stop))
        way = abs(stop - start)
        per_cell[axis] = 1.0 / way if way > 0 else np.inf
        to_border = at[axis] + 1.0 - start if stop > start else start - at[axis]
        until[axis] = to_border * per_cell[axis] if way > 0 else np.inf
        level = level and way == 0
    count, entered, given = 0, 0.0, np.int64(0)
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
        # Differences of a rounded running sum: the shares of one beam add up to ONE exactly.
        total = np.int64(np.rint(gone * ONE))
        if gone > entered or level:
            for axis in range(d):
                cells[count, axis] = at[axis]
            weights[count] = total - given if share else ONE
            count += 1
            given = total
        if not ahead:
            return count
        entered = max(entered, gone)
        at[step] += 1 if tips[i, step] > ends[i, step] else -1
        until[step] += per_cell[step]
