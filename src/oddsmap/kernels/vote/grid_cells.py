# SPDX-License-Identifier: Apache-2.0
"""Which pixel of a grid, seen at a pose, holds the centre of each map cell."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined

__all__ = ["list_seen_cells"]

FloatArray = npt.NDArray[np.float64]

# A grid that lies along the cells may have its borders on their centres: rounding must not decide
# there, or neighbouring cells would take turns between two pixels.
_ON_BORDER = 1e-6


@inlined
def _pixel_at(place: float) -> float:
    border = np.rint(place)
    return border if abs(place - border) <= _ON_BORDER else np.floor(place)


@borrowing
def list_seen_cells(
    seen: FloatArray,
    lo: npt.NDArray[np.int64],
    hi: npt.NDArray[np.int64],
    resolution: float,
    x: float,
    y: float,
    theta: float,
    corner: tuple[float, float],
    pixel: float,
    index: npt.NDArray[np.int64],
    values: FloatArray,
) -> int:
    """List the cells of a box whose centre lies in a pixel that says something.

    Args:
        seen: what the pixels say, shape (h, w), row = y of the sensor ascending; NaN: nothing.
        lo: first cell of the box, shape (2,), x first.
        hi: past the last one.
        resolution: side of a cell [m].
        x: position of the sensor in the map frame [m].
        y: likewise.
        theta: its heading [rad].
        corner: lower left corner of pixel (0, 0) in the sensor frame [m].
        pixel: side of a pixel [m].
        index: the cells, shape (n, 2), filled; room for all cells of the box.
        values: what their pixels say, shape (n,), filled.

    Returns:
        How many cells were listed.
    """
    height, width = seen.shape
    c, s = math.cos(theta), math.sin(theta)
    count = 0
    for iy in range(lo[1], hi[1]):
        north = (iy + 0.5) * resolution - y
        for ix in range(lo[0], hi[0]):
            east = (ix + 0.5) * resolution - x
            column = _pixel_at((c * east + s * north - corner[0]) / pixel)
            row = _pixel_at((c * north - s * east - corner[1]) / pixel)
            if 0.0 <= column < width and 0.0 <= row < height:
                value = seen[int(row), int(column)]
                if not math.isnan(value):
                    index[count, 0], index[count, 1] = ix, iy
                    values[count] = value
                    count += 1
    return count
