# SPDX-License-Identifier: Apache-2.0
"""A 2D map from a 3D map: what lies in a band of heights.

A column is as occupied as the most occupied of its seen cells. The other candidate, that at least
one cell is occupied, 1 - prod (1 - p), takes the cells' errors for independent: 20 cells, each
free with p = 0.1, would make a column of 0.88, a wall of nothing, and a finer resolution a denser
one. The largest p does not depend on how finely the band is cut, and it is exact where one thing
stands in a column. A cell never seen says nothing: it neither greys a column nor makes one known.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.evidence.evidence import Evidence
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.maps.voxel_map import VoxelMap
from oddsmap.odds import Thresholds
from oddsmap.posterior.belief import Belief
from oddsmap.posterior.log_odds import LogOdds
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

_MAX_CELLS = 1 << 31


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
    resolution = view.resolution
    index, probability = view.cells()
    if len(index) == 0:
        nothing = np.zeros((0, 0))
        return ProbabilityMap(nothing, nothing.astype(np.bool_), resolution)
    lo, hi = index[:, :2].min(axis=0), index[:, :2].max(axis=0) + 1
    nx, ny = (int(n) for n in hi - lo)
    if nx * ny > _MAX_CELLS:
        raise MapTooLargeError(f"the 2D map would have {nx} x {ny} cells; crop the map first")
    z = (index[:, 2] + 0.5) * resolution
    if ground is not None:
        limit = Thresholds() if isinstance(view, VoxelMap) else view.thresholds
        surface = _surface(ground, index, probability, limit, resolution)
        # Once per column, not once per cell: cells outnumber columns.
        number, cell = np.unique((index[:, :2] - lo) @ [1, nx], return_inverse=True)
        x, y = (number % nx + lo[0] + 0.5) * resolution, (number // nx + lo[1] + 0.5) * resolution
        z -= np.broadcast_to(np.asarray(surface(x, y), np.float64), x.shape)[cell]
    band = (z >= z_min) & (z < z_max)
    column = (index[band, :2] - lo) @ [1, nx]
    largest = np.full(nx * ny, -1.0)
    np.maximum.at(largest, column, probability[band])
    observed = largest >= 0.0
    prior = view.prior if isinstance(view, Belief) else 0.5
    return ProbabilityMap(
        probability=np.where(observed, largest, prior).reshape(ny, nx),
        observed=observed.reshape(ny, nx),
        resolution=resolution,
        origin=(float(lo[0]) * resolution, float(lo[1]) * resolution),
    )


def _surface(
    ground: Ground,
    index: npt.NDArray[np.int64],
    probability: FloatArray,
    limit: Thresholds,
    resolution: float,
) -> Callable[[FloatArray, FloatArray], FloatArray]:
    if isinstance(ground, GroundPlane | GroundSurface):
        return ground.at
    if callable(ground):
        return ground
    if ground == "relative":
        occupied, free = probability >= limit.occupied, probability <= limit.free
        return fit_ground_surface(index[occupied], resolution, index[free]).at
    raise ConfigError(
        'ground is None, "relative", a GroundPlane, a GroundSurface or a function of x and y, '
        f"got {ground!r}"
    )
