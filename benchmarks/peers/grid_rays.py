# SPDX-License-Identifier: Apache-2.0
"""Rays through a dense 2D grid as localisers cast them: Bresenham's line, and ray marching.

Written anew after what range_libc does (Walsh and Karaman, CDDT: fast approximate 2D ray casting
for accelerated localization, 2018), compiled by Numba, with its choices: a range is from the start
to the middle of the first occupied cell of Bresenham's line, or to where marching by the distance
to the nearest occupied cell, at least one cell at a time, comes into an occupied one. Neither
visits all cells that a ray passes.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

__all__ = ["bresenham", "distances", "march"]

FloatArray = npt.NDArray[np.float64]


def distances(occupied: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """From the middle of each cell to that of the nearest occupied one [cells]."""
    from scipy.ndimage import distance_transform_edt

    return np.asarray(distance_transform_edt(~occupied), np.float32)


@njit(nogil=True, error_model="numpy")
def bresenham(
    occupied: npt.NDArray[np.bool_], starts: FloatArray, ways: FloatArray, reach: float
) -> FloatArray:
    """Ranges by Bresenham's line [cells]; infinity where nothing is met.

    Args:
        occupied: shape (ny, nx).
        starts: in cells, shape (n, 2), x first.
        ways: of length 1, shape (n, 2).
        reach: how far [cells].
    """
    found = np.full(len(starts), np.inf)
    ny, nx = occupied.shape
    for i in range(len(starts)):
        x, y = math.floor(starts[i, 0]), math.floor(starts[i, 1])
        to_x = math.floor(starts[i, 0] + ways[i, 0] * reach)
        to_y = math.floor(starts[i, 1] + ways[i, 1] * reach)
        dx, dy = abs(to_x - x), abs(to_y - y)
        step_x, step_y = (1 if to_x > x else -1), (1 if to_y > y else -1)
        error = dx - dy
        for _ in range(dx + dy + 1):
            if x < 0 or y < 0 or x >= nx or y >= ny:
                break
            if occupied[y, x]:
                found[i] = math.hypot(x + 0.5 - starts[i, 0], y + 0.5 - starts[i, 1])
                break
            if x == to_x and y == to_y:
                break
            twice = 2 * error
            if twice > -dy:
                error -= dy
                x += step_x
            if twice < dx:
                error += dx
                y += step_y
    return found


@njit(nogil=True, error_model="numpy")
def march(
    distance: npt.NDArray[np.float32], starts: FloatArray, ways: FloatArray, reach: float
) -> FloatArray:
    """Ranges by ray marching [cells]: arguments as of `bresenham`, of `distances` the first."""
    found = np.full(len(starts), np.inf)
    ny, nx = distance.shape
    for i in range(len(starts)):
        t = 0.0
        while t < reach:
            x = math.floor(starts[i, 0] + ways[i, 0] * t)
            y = math.floor(starts[i, 1] + ways[i, 1] * t)
            if x < 0 or y < 0 or x >= nx or y >= ny:
                break
            near = distance[y, x]
            if near <= 0.0:
                found[i] = t
                break
            t += max(near * 0.999, 1.0)
    return found
