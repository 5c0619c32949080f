# SPDX-License-Identifier: Apache-2.0
"""How long each beam is inside each cell."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.trace.hit_region import walk
from oddsmap.kernels.units import ONE
from oddsmap.kernels.vote.cell_votes import gather_cells

__all__ = ["gather_lengths"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@borrowing
def gather_lengths(
    origins: FloatArray,
    whose: IntArray,
    ends: FloatArray,
    first: int,
    lo: IntArray,
    side: int,
    strides: IntArray,
    cells: IntArray,
    left: FloatArray,
    units: IntArray,
    nothing: IntArray,
    table: npt.NDArray[np.int32],
    used: IntArray,
    weights: IntArray,
) -> int:
    """Add the lengths of one scan's beams to a window, each rounded to 1/65536 of a cell's side.

    Args:
        origins: where bundles of beams start [cells], shape (bundles, d).
        whose: the bundle of each beam, shape (n,).
        ends: where each beam ends, shape (n, d).
        first: which beam to begin with.
        lo: first cell of the window, see `gather_cells`.
        side: cells along a block's side.
        strides: see `gather_cells`.
        cells: room for the cells of one beam, shape (enough, d).
        left: room for where they are left, shape (enough,).
        units: room for the lengths in them, shape (enough,).
        nothing: zeros, shape (enough,).
        table: see `gather_cells`.
        used: see `gather_cells`.
        weights: see `gather_cells`; lengths go where passes do.

    Returns:
        Which beam to go on with once there is room for more blocks; -1 when done.
    """
    d = origins.shape[1]
    for i in range(first, ends.shape[0]):
        origin = origins[whose[i]]
        count = walk(origin, ends[i], cells, left)
        if used[0] + count > used.shape[0] - 1:
            return i
        square = 0.0
        for axis in range(d):
            square += (ends[i, axis] - origin[axis]) ** 2
        way, entered = math.sqrt(square), 0.0
        for k in range(count):
            units[k] = np.int64(np.rint((left[k] - entered) * way * ONE))
            entered = left[k]
        gather_cells(cells, nothing, units, 0, count, lo, side, strides, True, table, used, weights)
    return -1
