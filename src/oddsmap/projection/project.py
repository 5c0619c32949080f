# SPDX-License-Identifier: Apache-2.0
"""A 2D map from a 3D map: what lies in a band of heights.

A column is as occupied as the most occupied of its seen cells. The other candidate, that at least
one cell is occupied, 1 - prod (1 - p), takes the cells' errors for independent: 20 cells, each
free with p = 0.1, would make a column of 0.88, a wall of nothing, and a finer resolution a denser
one. The largest p does not depend on how finely the band is cut, and it is exact where one thing
stands in a column. A cell never seen says nothing: it neither greys a column nor makes one known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.maps.voxel_map import VoxelMap
from oddsmap.odds import Thresholds, sigmoid
from oddsmap.posterior.belief import Belief
from oddsmap.posterior.log_odds import LogOdds
from oddsmap.projection.columns import Columns
from oddsmap.projection.ground_plane import GroundPlane
from oddsmap.projection.ground_surface import GroundSurface, fit_ground_surface

__all__ = ["Ground", "project"]

Ground = (
    Literal["relative"]
    | GroundPlane
    | GroundSurface
    | Callable[[FloatArray, FloatArray], FloatArray]
    | None
)

_FAR = float(1 << 50)  # [cells]: beyond all cells, and still a whole number


def project(
    source: Evidence | Belief | VoxelMap,
    z_min: float,
    z_max: float,
    *,
    ground: Ground = None,
) -> ProbabilityMap:
    """Project a band of heights of a 3D map to a 2D map.

    A cell belongs to the band where its centre does: z_min <= z < z_max. Its column is observed
    where any cell of the band is, with the largest probability among those.

    Args:
        source: the map, or a view of it with a prior or sensor model of its own.
        z_min: lower end of the band [m]; -inf for all.
        z_max: upper end of the band [m]; inf for all.

    Other Args:
        ground: what heights are measured from. None: z = 0 of the map frame. "relative": the
            lowest surfaces, which follows tilts, ramps and terraces, see
            `fit_ground_surface`. Or a `GroundPlane`, a `GroundSurface`, or
            a function of x and y [m], arrays of shape (n,), that gives the ground's z [m].

    Returns:
        The rectangle of all known columns, whatever their height.

    Raises:
        InputError: a 2D map, or no occupied cell to find the ground by.
        ConfigError: not z_min < z_max.
        MapTooLargeError: a rectangle of more than 2^31 columns.
    """
    if not z_min < z_max:
        raise ConfigError(f"a height band needs z_min < z_max [m], got {z_min} and {z_max}")
    view = LogOdds(source) if isinstance(source, Evidence) else source
    if isinstance(view, Belief) and view.ndim != 3:
        raise InputError("only a 3D map can be projected, this one is 2D already")
    box = _box(view)
    if box is None:
        nothing = np.zeros((0, 0))
        return ProbabilityMap(nothing, nothing.astype(np.bool_), view.resolution)
    columns = Columns(*box, view.resolution)
    heights = None if ground is None else _heights(ground, view, columns)
    largest = np.full(columns.count, -1.0)
    for index, probability in _cells(view, _layers(z_min, z_max, view, heights)):
        column = columns.number(index)
        z = (index[:, 2] + 0.5) * view.resolution
        if heights is not None:
            z -= heights[column]
        band = (z >= z_min) & (z < z_max)
        np.maximum.at(largest, column[band], probability[band])
    observed = largest >= 0.0
    largest[~observed] = view.prior if isinstance(view, Belief) else 0.5
    return ProbabilityMap(
        probability=largest.reshape(columns.shape),
        observed=observed.reshape(columns.shape),
        resolution=view.resolution,
        origin=columns.origin,
    )


def _box(view: Belief | VoxelMap) -> tuple[IntArray, IntArray] | None:
    """The box of the cells with a probability; lengths of beams may lie beyond."""
    return view.evidence.census().bounds if isinstance(view, LogOdds) else view.bounds()


def _cells(
    view: Belief | VoxelMap, z: tuple[int, int] | None = None
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Index and probability of the cells, some at a time; of those of some layers at least."""
    if isinstance(view, VoxelMap):
        yield view.cells()
    else:
        yield from view.parts(sigmoid, z=z)


def _layers(
    z_min: float, z_max: float, view: Belief | VoxelMap, heights: FloatArray | None
) -> tuple[int, int] | None:
    """Layers of cells that may lie in the band, first and past the last; None: all may."""
    low, high = (limit / view.resolution for limit in (z_min, z_max))
    if heights is not None or not max(abs(low), abs(high)) < _FAR:
        return None
    return math.floor(low) - 1, math.ceil(high) + 1


def _heights(ground: Ground, view: Belief | VoxelMap, columns: Columns) -> FloatArray:
    """Height of the ground in each column [m]; where no cell is known, nothing to go by."""
    seen = np.zeros(columns.count, np.bool_)
    occupied, free = columns.nowhere(), columns.nowhere()
    limit = Thresholds() if isinstance(view, VoxelMap) else view.thresholds
    for index, probability in _cells(view):
        seen[columns.number(index)] = True
        if ground == "relative":
            columns.lower(occupied, index[probability >= limit.occupied])
            columns.lower(free, index[probability <= limit.free])
    lowest = (columns.lowest_cells(occupied), columns.lowest_cells(free))
    surface = _surface(ground, *lowest, view.resolution)
    # Once per column, not once per cell: cells outnumber columns.
    number = np.flatnonzero(seen)
    x, y = ((columns.place(number) + 0.5) * view.resolution).T
    heights = np.full(columns.count, np.nan)
    heights[number] = np.asarray(surface(x, y), np.float64)
    return heights


def _surface(
    ground: Ground, occupied: IntArray, free: IntArray, resolution: float
) -> Callable[[FloatArray, FloatArray], FloatArray]:
    if isinstance(ground, GroundPlane | GroundSurface):
        return ground.at
    if callable(ground):
        return ground
    if ground == "relative":
        return fit_ground_surface(occupied, resolution, free).at
    raise ConfigError(
        'ground is None, "relative", a GroundPlane, a GroundSurface or a function of x and y, '
        f"got {ground!r}"
    )
