# SPDX-License-Identifier: Apache-2.0
"""A 2D map from a 3D map: what lies in a band of heights.

Which heights count is decided by `band.py`, what a column's cells say together by `rules.py`, and
how high the ground is by `ground_surface.py`. One candidate is no rule there: that at least one
cell is occupied, 1 - prod (1 - p), takes the cells' errors for independent. 20 cells, each free
with p = 0.1, would make a column of 0.88, a wall of nothing, and a finer resolution a denser one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Literal

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.maps.voxel_map import VoxelMap
from oddsmap.odds import Thresholds, decided_by, logit, sigmoid
from oddsmap.posterior.belief import Belief
from oddsmap.posterior.count_view import CountView
from oddsmap.posterior.log_odds import LogOdds
from oddsmap.projection.band import Band
from oddsmap.projection.columns import Columns
from oddsmap.projection.ground_plane import GroundPlane
from oddsmap.projection.ground_surface import GroundSurface, fit_ground_surface
from oddsmap.projection.rules import by_largest, by_slabs
from oddsmap.projection.undecided import note_of_undecided

__all__ = ["SLAB", "Ground", "Rule", "project"]

Ground = (
    Literal["relative"]
    | GroundPlane
    | GroundSurface
    | Callable[[FloatArray, FloatArray], FloatArray]
    | None
)

Rule = Literal["slabs", "largest"]
"""What a column's cells say together: see `oddsmap.projection.rules`."""

SLAB = 0.3
"""Height of a slab, where none is stated [m]."""


def project(
    source: Evidence | Belief | VoxelMap,
    z_min: float,
    z_max: float,
    *,
    ground: Ground = None,
    rule: Rule = "slabs",
    slab: float | None = None,
    thresholds: Thresholds | None = None,
) -> ProbabilityMap:
    """Project a band of heights of a 3D map to a 2D map: is anything in it in the way?

    A cell belongs to the band where its centre does: z_min <= z < z_max. A column of which no
    cell in the band was seen is unknown.

    Args:
        source: the map, or a view of it with a prior or sensor model of its own.
        z_min: lower end of the band [m]; -inf for all.
        z_max: upper end of the band [m]; inf for all.

    Other Args:
        ground: what heights are measured from. None: z = 0 of the map frame. "relative": the
            lowest surfaces, which follows tilts, ramps and terraces, see
            `fit_ground_surface`. Or a `GroundPlane`, a `GroundSurface`, or
            a function of x and y [m], arrays of shape (n,), that gives the ground's z [m].
        rule: what makes a column free. "slabs": enough passes in each slab of the band, taken
            together, and no cell that is rather occupied. "largest": enough passes in each seen
            cell. Either way a column is as occupied as its most occupied cell, if one is rather
            occupied.
        slab: height of a slab [m], by default 0.3: what is lower may be missed between beams. 0:
            each cell is one; inf: all of the band is one.
        thresholds: which columns count as undecided in the notes; default: the view's.

    Returns:
        The rectangle of all known columns, whatever their height. Its `notes` say what share of
        the known columns is undecided, and why.

    Raises:
        InputError: a 2D map, or no occupied cell to find the ground by.
        ConfigError: not z_min < z_max, an unknown rule, or a slab that it does not know.
        MapTooLargeError: a rectangle of more than 2^31 columns.
    """
    if not z_min < z_max:
        raise ConfigError(f"a height band needs z_min < z_max [m], got {z_min} and {z_max}")
    height = _slab(rule, slab)
    view = LogOdds(source) if isinstance(source, Evidence) else source
    if isinstance(view, Belief) and view.ndim != 3:
        raise InputError("only a 3D map can be projected, this one is 2D already")
    box = _box(view)
    if box is None:
        nothing = np.zeros((0, 0))
        return ProbabilityMap(nothing, nothing.astype(np.bool_), view.resolution)
    columns = Columns(*box, view.resolution)
    heights = None if ground is None else _heights(ground, view, columns)
    band = Band(z_min, z_max, view.resolution, (int(box[0][2]), int(box[1][2])), heights)
    prior = float(logit(view.prior)) if isinstance(view, Belief) else 0.0
    judged = (
        by_largest(partial(_cells, view), columns, band)
        if rule == "largest"
        else by_slabs(partial(_cells, view), columns, band, height, prior)
    )
    probability = sigmoid(judged.log_odds)
    probability[~judged.known] = view.prior if isinstance(view, Belief) else 0.5
    own = view.thresholds if isinstance(view, Belief) else Thresholds()
    limits = decided_by(thresholds, own)
    return ProbabilityMap(
        probability=probability.reshape(columns.shape),
        observed=judged.known.reshape(columns.shape),
        resolution=view.resolution,
        origin=columns.origin,
        notes=tuple(note_of_undecided(probability, judged, limits, height)),
    )


def _slab(rule: Rule, slab: float | None) -> float:
    """The height of a slab that is asked for [m]."""
    if rule not in ("slabs", "largest"):
        raise ConfigError(f'rule is "slabs" or "largest", got {rule!r}')
    if slab is None:
        return SLAB
    if rule != "slabs":
        raise ConfigError(f'slab is for rule "slabs"; rule {rule!r} looks at single cells')
    if not slab >= 0.0:
        raise ConfigError(f"slab is a height of 0 m or more, got {slab}")
    return float(slab)


def _box(view: Belief | VoxelMap) -> tuple[IntArray, IntArray] | None:
    """The box of the cells with a probability; lengths of beams may lie beyond."""
    return view.evidence.census().bounds if isinstance(view, CountView) else view.bounds()


def _cells(
    view: Belief | VoxelMap, z: tuple[int, int] | None = None
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Index and log odds of the cells, some at a time; of those of some layers at least."""
    if isinstance(view, VoxelMap):
        yield view.known_log_odds()
    else:
        yield from view.parts(np.asarray, z=z)


def _heights(ground: Ground, view: Belief | VoxelMap, columns: Columns) -> FloatArray:
    """Height of the ground in each column [m]; where no cell is known, nothing to go by."""
    seen = np.zeros(columns.count, np.bool_)
    occupied, free = columns.nowhere(), columns.nowhere()
    limit = Thresholds() if isinstance(view, VoxelMap) else view.thresholds
    for index, log_odds in _cells(view):
        probability = sigmoid(log_odds)
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
