# SPDX-License-Identifier: Apache-2.0
"""Where the ground is: a surface that follows ramps, terraces and hills.

Patches of 1 x 1 m get a height from the lowest occupied cells of their columns; what cannot be
ground is taken out; what is left is joined by straight lines. The filter is the progressive
morphological filter of Zhang, Chen, Whitman, Shyu, Yan and Zhang (2003), "A progressive
morphological filter for removing nonground measurements from airborne LIDAR data", IEEE TGRS 41(4).
A map knows more than the point clouds it was made for: where space was seen free. Nobody sees
through the ground, so a surface with free space beneath it is a table, a roof or a ceiling. And
free space reaches down to the ground: what lies deep below it is a ghost, a ceiling mirrored in a
wet or polished floor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.errors import InputError
from oddsmap.projection.ground_plane import (
    GroundPlane,
    fit_ground,
    lowest_of_columns,
    plane_through,
)
from oddsmap.short_repr import short_repr

__all__ = ["GroundSurface", "fit_ground_surface"]


_PATCH = 1.0  # [m]
_QUANTILE = 0.25  # of a patch's columns; below it ghosts, above it what stands there
_BENEATH = 0.5  # [m] of free space under a surface: it hangs
_BURIED = 1.0  # [m] from a surface up to the free space around: it is a ghost
# A height needs 12 patches within 0.5 m of it, among the 9 x 9 around: small ghosts, table tops
# and the lower ends of walls have fewer.
_SUPPORT, _REACH, _ALIKE = 12, 4, 0.5
# Zhang's windows, 2 h + 1 patches wide, and thresholds: 0.3, 0.6, 0.9, 1.5 and 2.7 m.
_HALF_WINDOWS = (1, 2, 4, 8, 16)
_SLOPE = 0.15  # against the plane of the whole: 8.5 degrees
_STEP = 0.3  # [m]


@dataclass(frozen=True, slots=True, eq=False)
class GroundSurface:
    """Height of the ground: a plane, and offsets from it at the centres of a grid of patches.

    Args:
        plane: the tilt of the whole.
        offset: height above the plane at the patches' centres [m], shape (ny, nx); bilinear
            between them, constant beyond the outermost.
        corner: x and y of the grid's lower corner, in patches from the map's origin.
        patch: side of a patch [m].
    """

    plane: GroundPlane
    offset: FloatArray
    corner: tuple[int, int]
    patch: float

    __repr__ = short_repr

    def at(self, x: npt.ArrayLike, y: npt.ArrayLike) -> FloatArray:
        """Height of the ground at places [m]."""
        x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        ny, nx = self.offset.shape
        u = np.clip(x / self.patch - self.corner[0] - 0.5, 0, nx - 1)
        v = np.clip(y / self.patch - self.corner[1] - 0.5, 0, ny - 1)
        i, j = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
        right, up = np.minimum(i + 1, nx - 1), np.minimum(j + 1, ny - 1)
        u, v = u - i, v - j
        low = (1 - u) * self.offset[j, i] + u * self.offset[j, right]
        high = (1 - u) * self.offset[up, i] + u * self.offset[up, right]
        return np.asarray(self.plane.at(x, y) + (1 - v) * low + v * high, np.float64)


def fit_ground_surface(
    occupied: IntArray, resolution: float, free: IntArray | None = None
) -> GroundSurface:
    """Find the surface of the ground among the occupied cells.

    1. Of each column the lowest occupied cell counts, unless free space was seen 0.5 m (at least
       two cells) or more beneath it: then the surface hangs. Nor does it count 1 m or more below
       all free space in its patch and the eight around: then it is a ghost.
    2. A patch of 1 x 1 m (a cell, where that is larger) is as high as the quarter quantile of its
       columns (the mean of those within two cells, at least 0.1 m, of it). 12 of the 9 x 9 patches
       around it, itself counted, must be as high as it to 0.5 m.
    3. Of those, what stands out is taken out: what is narrower than 3, 5, 9, 17 or 33 m (and so
       goes at a morphological opening) and higher than 0.3, 0.6, 0.9, 1.5 or 2.7 m. So a terrace
       of 0.5 m is ground where it is 3 m wide, and a roof of 3 m whose underside nobody saw, where
       it is 33 m wide.
    4. A patch without ground takes the height of the nearest one that has it, along the tilt of
       the whole.

    Heights are taken above the tilt of the whole: at first `fit_ground`, then, to do 2 and 3
    again, a plane through the patches found. Where no patch is left, that plane is the ground.

    Args:
        occupied: the occupied cells, shape (n, 3), x first.
        resolution: side of a cell [m].
        free: the free cells, shape (m, 3); None: nothing is known of them.

    Returns:
        The surface through the centres of the ground's cells.

    Raises:
        InputError: no cell is occupied.
    """
    if len(occupied) == 0:
        raise InputError("no cell is occupied: there is no ground to measure heights from")
    plane = fit_ground(occupied, resolution)
    cells = lowest_of_columns(occupied)
    across = max(1, round(_PATCH / resolution))
    if free is not None and len(free):
        reach = lowest_of_columns(free)
        hangs = _hangs(cells, reach, resolution)
        cells = cells[~(hangs | _is_buried(cells, reach, across, resolution))]
    patch = across * resolution
    if len(cells) == 0:
        return GroundSurface(plane, np.zeros((1, 1)), (0, 0), patch)
    number = cells[:, :2] // across
    corner = number.min(axis=0)
    nx, ny = (int(n) for n in number.max(axis=0) - corner + 1)
    at = (number - corner) @ [1, nx]
    centre = (cells + 0.5) * resolution
    for _ in range(2):
        above = centre[:, 2] - plane.at(centre[:, 0], centre[:, 1])
        height = _height_of_patches(at, above, nx * ny, resolution).reshape(ny, nx)
        ground = _not_standing_out(height, _supported(height), resolution)
        if not ground.any():
            return GroundSurface(plane, np.zeros((1, 1)), (0, 0), patch)
        j, i = np.nonzero(ground)
        place = (np.column_stack([i, j]) + corner + 0.5) * patch
        z = height[ground] + plane.at(place[:, 0], place[:, 1])
        plane = plane_through(place, z)
    offset = np.zeros((ny, nx))
    offset[ground] = z - plane.at(place[:, 0], place[:, 1])
    return GroundSurface(plane, _filled(offset, ground), (int(corner[0]), int(corner[1])), patch)


def _hangs(lowest: IntArray, free: IntArray, resolution: float) -> BoolArray:
    """Which lowest occupied cells have free space far below; `free`: the lowest of columns."""
    base = np.minimum(lowest.min(axis=0), free.min(axis=0))[:2]
    width = int(max(lowest[:, 1].max(), free[:, 1].max()) - base[1] + 1)
    # Both in the order of (x, y), so are their numbers.
    column, seen = (lowest[:, :2] - base) @ [width, 1], (free[:, :2] - base) @ [width, 1]
    at = np.minimum(np.searchsorted(seen, column), len(seen) - 1)
    deep = (lowest[:, 2] - free[at, 2]) * resolution >= max(_BENEATH, 2.0 * resolution)
    return np.asarray((seen[at] == column) & deep)


def _is_buried(lowest: IntArray, free: IntArray, across: int, resolution: float) -> BoolArray:
    """Which lowest occupied cells lie far below all free space of the 3 x 3 patches around."""
    from scipy.ndimage import minimum_filter

    own, theirs = lowest[:, :2] // across, free[:, :2] // across
    base = own.min(axis=0) - 1
    shape = own.max(axis=0) - base + 2
    inside = ((theirs >= base) & (theirs < base + shape)).all(axis=1)
    # Nothing seen free around: nothing known.
    reach = np.full(shape, np.inf)
    np.minimum.at(reach, tuple((theirs[inside] - base).T), free[inside, 2].astype(np.float64))
    reach = minimum_filter(reach, 3, mode="constant", cval=np.inf)
    gap = (reach[tuple((own - base).T)] - lowest[:, 2]) * resolution
    return np.asarray(np.isfinite(gap) & (gap >= max(_BURIED, 2.0 * resolution)))


def _height_of_patches(
    at: IntArray, above: FloatArray, count: int, resolution: float
) -> FloatArray:
    """Height of each patch, NaN without a column."""
    order = np.lexsort((above, at))
    at, above = at[order], above[order]
    start = np.flatnonzero(np.append(True, at[1:] != at[:-1]))
    columns = np.diff(np.append(start, len(at)))
    level = above[start + (_QUANTILE * columns).astype(np.int64)]
    # The mean about the quantile: the quantile itself lies low on a slope and in noise.
    near = np.abs(above - np.repeat(level, columns)) <= max(2.0 * resolution, 0.1)
    height = np.full(count, np.nan)
    height[at[start]] = np.add.reduceat(above * near, start) / np.add.reduceat(near * 1.0, start)
    return height


def _supported(height: FloatArray) -> BoolArray:
    """Which patches have enough others of their height around them."""
    ny, nx = height.shape
    wide = np.pad(height, _REACH, constant_values=np.nan)
    alike = np.zeros(height.shape, np.int64)
    for j in range(2 * _REACH + 1):
        for i in range(2 * _REACH + 1):
            alike += np.abs(wide[j : j + ny, i : i + nx] - height) <= _ALIKE
    return alike >= _SUPPORT


def _not_standing_out(height: FloatArray, ground: BoolArray, resolution: float) -> BoolArray:
    """The progressive morphological filter; windows have their middle on ground."""
    from scipy.ndimage import maximum_filter, minimum_filter

    step = max(_STEP, resolution)
    last = 1
    for half in _HALF_WINDOWS:
        width = 2 * half + 1
        low = minimum_filter(np.where(ground, height, np.inf), width, mode="constant", cval=np.inf)
        low = np.where(ground, low, -np.inf)
        opened = maximum_filter(low, width, mode="constant", cval=-np.inf)
        limit = step + (_SLOPE * (width - last) if half > 1 else 0.0)
        ground = ground & (np.where(ground, height, np.inf) - opened <= limit)
        last = width
    return ground


def _filled(offset: FloatArray, ground: BoolArray) -> FloatArray:
    from scipy.ndimage import distance_transform_edt

    j, i = distance_transform_edt(~ground, return_distances=False, return_indices=True)
    return np.asarray(offset[j, i], np.float64)
