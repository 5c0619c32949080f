# SPDX-License-Identifier: Apache-2.0
"""Where the ground is, roughly: a plane through the lowest surfaces of a 3D map.

A map's z axis is seldom plumb: a tilt of 2 degrees lifts the floor by 1.75 m over 50 m, and no
band of absolute heights holds the obstacles of both ends. `ground_surface` starts from this plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import InputError

__all__ = ["GroundPlane", "fit_ground", "lowest_of_columns", "plane_through"]


_PATCH = 1.0  # [m]: a dense corner must not outvote a sparse field
_QUANTILE = 0.25
_ROUNDS = 60


@dataclass(frozen=True, slots=True)
class GroundPlane:
    """Height of the ground: z = height + slope_x * x + slope_y * y, all in metres.

    Args:
        height: at the origin of the map frame [m].
        slope_x: rise along x [m/m].
        slope_y: rise along y [m/m].
    """

    height: float
    slope_x: float = 0.0
    slope_y: float = 0.0

    def at(self, x: npt.ArrayLike, y: npt.ArrayLike) -> FloatArray:
        """Height of the ground at places [m]."""
        return np.asarray(
            self.height + self.slope_x * np.asarray(x) + self.slope_y * np.asarray(y), np.float64
        )


def fit_ground(index: IntArray, resolution: float) -> GroundPlane:
    """Fit a plane to the lowest occupied cell of each column.

    1. Of each patch of 1 x 1 m, the quarter quantile of its columns' lowest occupied cells counts:
       tables, and returns mirrored below a wet floor, lose within their patch.
    2. Quantile regression over the patches, again for the quarter, by reweighted least squares: up
       to about 3/4 of the patches may lie above the ground (walls, roofs, ceilings with no floor in
       sight), and up to about 1/4 below.
    3. Least squares over the patches within two cells, at least 0.1 m, of that plane.

    It is one plane; for ramps, steps and hills see `fit_ground_surface`.

    Args:
        index: the occupied cells, shape (n, 3), x first.
        resolution: side of a cell [m].

    Returns:
        The plane through the centres of the ground's cells.

    Raises:
        InputError: no cell is occupied.
    """
    if len(index) == 0:
        raise InputError("no cell is occupied: there is no ground to measure heights from")
    place, z = _lowest_of_patches(index, resolution)
    # About the middle: at UTM coordinates the sums would lose all their digits.
    middle = place.mean(axis=0)
    basis = np.column_stack([np.ones(len(z)), place - middle])
    level = z.mean()
    plane = _quantile_plane(basis, z, _QUANTILE)
    near = np.abs(z - basis @ plane) <= max(2.0 * resolution, 0.1)
    if np.count_nonzero(near) >= 3:
        plane = _least_squares(basis, z, near.astype(np.float64), level)
    height = plane[0] - plane[1:] @ middle
    return GroundPlane(float(height), float(plane[1]), float(plane[2]))


def lowest_of_columns(index: IntArray) -> IntArray:
    """The lowest cell of each column, in the order of (x, y).

    Args:
        index: cells, shape (n, 3), x first, in any order.

    Returns:
        Shape (m, 3), one row per column.
    """
    cells = index[np.lexsort(index.T[::-1])]
    first = np.ones(len(cells), np.bool_)
    first[1:] = (cells[1:, :2] != cells[:-1, :2]).any(axis=1)
    return np.asarray(cells[first], np.int64)


def plane_through(place: FloatArray, z: FloatArray) -> GroundPlane:
    """The plane through the most of some points: that of least absolute deviations.

    Across points in one line it is level.

    Args:
        place: x and y [m], shape (n, 2), n > 0.
        z: heights [m], shape (n,).

    Returns:
        The plane.
    """
    middle = place.mean(axis=0)
    basis = np.column_stack([np.ones(len(z)), place - middle])
    plane = _quantile_plane(basis, z, 0.5)
    return GroundPlane(float(plane[0] - plane[1:] @ middle), float(plane[1]), float(plane[2]))


def _lowest_of_patches(index: IntArray, resolution: float) -> tuple[FloatArray, FloatArray]:
    cells = lowest_of_columns(index)
    across = max(1, round(_PATCH / resolution))
    patch = cells[:, :2] // across
    cells = cells[np.lexsort((cells[:, 2], patch[:, 1], patch[:, 0]))]
    patch = cells[:, :2] // across
    begin = np.ones(len(cells), np.bool_)
    begin[1:] = (patch[1:] != patch[:-1]).any(axis=1)
    start = np.flatnonzero(begin)
    count = np.diff(np.append(start, len(cells)))
    chosen = cells[start + (_QUANTILE * count).astype(np.int64)]
    centre = np.asarray((chosen + 0.5) * resolution, np.float64)
    return centre[:, :2], centre[:, 2]


def _quantile_plane(basis: FloatArray, z: FloatArray, quantile: float) -> FloatArray:
    level = float(z.mean())
    plane = np.array([np.quantile(z, quantile), 0.0, 0.0])
    for _ in range(_ROUNDS):
        off = z - basis @ plane
        # The check function of quantile regression, as weights of squares; 1 mm against 0 / 0.
        weight = np.where(off > 0.0, quantile, 1.0 - quantile) / np.maximum(np.abs(off), 1e-3)
        plane = _least_squares(basis, z, weight, level)
    return plane


def _least_squares(
    basis: FloatArray, z: FloatArray, weight: FloatArray, level: float
) -> FloatArray:
    # lstsq, not solve: patches in one line leave a slope open, which is 0 then.
    root = np.sqrt(weight)
    plane, *_ = np.linalg.lstsq(basis * root[:, None], (z - level) * root, rcond=1e-9)
    plane[0] += level
    return np.asarray(plane, np.float64)
