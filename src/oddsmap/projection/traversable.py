# SPDX-License-Identifier: Apache-2.0
"""Where a robot can drive: floor, steps, slopes and clearance of a 3D map.

ground   = the surface that the map stands on        # ground_surface.py
floor    = per column the highest occupied cell near the ground
blocked  = something between the floor and the robot's height
step     = the floor is higher than a neighbour's by more than the robot climbs
slope    = the plane through the floor around is steeper than it climbs
drop     = free space goes down deep below the ground
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.cell_index import check_room
from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.maps.voxel_map import VoxelMap
from oddsmap.odds import Thresholds, decided_by, sigmoid
from oddsmap.plot.thumbnail import Pictured, Thumbnail
from oddsmap.posterior.belief import Belief
from oddsmap.posterior.log_odds import LogOdds
from oddsmap.projection.columns import Columns
from oddsmap.projection.floor import Limits, Verdict, judge_columns
from oddsmap.projection.ground_plane import GroundPlane
from oddsmap.projection.ground_surface import GroundSurface, fit_ground_surface
from oddsmap.query.given_numbers import check_numbers
from oddsmap.short_repr import FEW_CELLS, described, extent_of, grid_facts

if TYPE_CHECKING:
    from typing import Unpack

    from matplotlib.axes import Axes

    from oddsmap.plot.on_axes import PlotOptions

__all__ = ["Traversability", "traversable"]

# What each layer of a column in the band takes: its state, its height, and what is asked of them.
_BYTES = 32
# What a map for planners says of a cell that is free, and of one that is not.
_FREE, _OCCUPIED, _UNDECIDED = 0.02, 0.98, 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Traversability(Pictured):
    """What a robot meets in each column of a map, arrays of shape (ny, nx), y ascending.

    Attributes:
        verdict: values of `Verdict`.
        floor: height of the floor [m]; NaN where none was seen.
        fits: True where the robot may stand: all cells within its radius are free.
        resolution: side of a cell [m].
        origin: position of the lower left corner of cell (0, 0) in the map frame [m].
    """

    verdict: npt.NDArray[np.int8]
    floor: FloatArray
    fits: BoolArray
    resolution: float
    origin: tuple[float, float]

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        ny, nx = self.verdict.shape
        yield from grid_facts(2, self.resolution, None, None)
        yield extent_of(self.origin, np.add(self.origin, np.array([nx, ny]) * self.resolution))
        if self.verdict.size <= FEW_CELLS:
            known = (verdict for verdict in Verdict if verdict != Verdict.UNKNOWN)
            counts = ((np.count_nonzero(self.verdict == v), v.name.lower()) for v in known)
            yield "columns: " + ", ".join(f"{n:,} {name.replace('_', ' ')}" for n, name in counts)

    def to_probability_map(self) -> ProbabilityMap:
        """A 2D map for planners: free cells 0.02, what cannot be driven over 0.98.

        Cells are not widened by the robot's radius: planners do that (Nav2's inflation).
        """
        p = np.full(self.verdict.shape, _OCCUPIED)
        p[self.verdict == Verdict.FREE] = _FREE
        p[self.verdict == Verdict.UNDECIDED] = _UNDECIDED
        seen = self.verdict != Verdict.UNKNOWN
        p[~seen] = 0.5
        return ProbabilityMap(p, seen, self.resolution, self.origin)

    def _thumbnail(self) -> Thumbnail | None:
        return self.to_probability_map()._thumbnail()

    def plot(self, ax: Axes | None = None, **options: Unpack[PlotOptions]) -> Axes:
        """Draw the verdicts into axes of Matplotlib: see `oddsmap.plot.on_axes.plot_probability`.

        Args:
            ax: where; None: the current axes of pyplot.
            options: title, trajectory, crop, whole, colour_bar, cmap: see
                `oddsmap.plot.on_axes.PlotOptions`.
        """
        from oddsmap.plot.on_axes import plot_probability

        label = "free (white), undecided (grey), blocked (black)"
        return plot_probability(self.to_probability_map(), ax, label=label, **options)

    def save_ros(self, path: str | os.PathLike[str], *, force: bool = False) -> tuple[Path, Path]:
        """Write it as a ROS map: see `oddsmap.map_files.ros_writer.save_ros`."""
        from oddsmap.map_files.ros_writer import save_ros

        return save_ros(self.to_probability_map(), Path(path), force=force)


def traversable(
    source: Evidence | Belief | VoxelMap,
    *,
    robot_height: float = 1.0,
    robot_radius: float = 0.3,
    max_step: float = 0.15,
    max_slope_deg: float = 20.0,
    ground: GroundPlane | GroundSurface | None = None,
    thresholds: Thresholds | None = None,
) -> Traversability:
    """Say where a robot can drive in a 3D map.

    The floor of a column is the highest occupied cell within 0.3 m (or `max_step`, where that is
    more) of the ground. Where free space was seen there and no floor, it is taken to be at the
    ground, so that few beams leave no holes; where free space goes down farther than that, it is a
    drop. Of two neighbours the higher is the step. Cells never seen say nothing, nor do undecided
    ones that are at most a step above the floor: the floor's own rounding.

    Args:
        source: the map, or a view of it with a prior or sensor model of its own.
        robot_height: what has to be free above the floor [m].
        robot_radius: of a circle that holds the robot [m]; for `Traversability.fits`.
        max_step: the highest step that it climbs [m], at least the side of a cell: lower ones
            cannot be told from the rounding to cells.
        max_slope_deg: the steepest slope [deg]. It is that of the plane through the floor within
            0.5 m, or the robot's radius, where that is more.
        ground: where the ground is; None: `fit_ground_surface`.
        thresholds: what is free and what is occupied; None: the view's.

    Raises:
        InputError: a 2D map or none of these, or no occupied cell to find the ground by.
        ConfigError: an argument is outside its range.
        MapTooLargeError: the band above the ground would not fit in memory.
    """
    view = LogOdds(source) if isinstance(source, Evidence) else source
    if not isinstance(view, Belief | VoxelMap):
        raise InputError(
            "a floor is found in evidence, a view of probabilities or an OctoMap, got "
            f"{type(source).__name__}"
        )
    if view.ndim != 3:
        raise InputError("a floor needs a 3D map, this one is 2D")
    check_numbers(
        robot_height=robot_height, robot_radius=robot_radius, max_step=max_step,
        max_slope_deg=max_slope_deg,
    )  # fmt: skip
    if ground is not None and not isinstance(ground, GroundPlane | GroundSurface):
        raise InputError(
            "the ground is a GroundPlane or a GroundSurface, or None to find it in the map; got "
            f"{ground!r}"
        )
    limits = Limits(robot_height, max_step, math.tan(math.radians(max_slope_deg)), robot_radius)
    _check(limits, max_slope_deg, view.resolution)
    own = view.thresholds if isinstance(view, Belief) else Thresholds()
    states = decided_by(thresholds, own)
    box = view.bounds()
    if box is None:
        nothing = np.zeros((0, 0))
        none = nothing.astype(np.bool_)
        return Traversability(nothing.astype(np.int8), nothing, none, view.resolution, (0.0, 0.0))
    columns = Columns(*box, view.resolution)
    place = (columns.place(np.arange(columns.count)) + 0.5) * view.resolution
    surface = _ground(view, columns, states) if ground is None else ground
    height = surface.at(place[:, 0], place[:, 1])
    base = np.floor((height - limits.reach) / view.resolution).astype(np.int64) - 1
    layers = math.ceil((2.0 * limits.reach + robot_height) / view.resolution) + 3
    check_room(np.zeros(2, np.int64), np.array([columns.count, layers]), _BYTES)
    band = np.zeros((layers, columns.count), np.uint8)
    below = np.zeros(columns.count, np.bool_)
    for index, state in _states(view, states):
        column = columns.number(index)
        layer = index[:, 2] - base[column]
        inside = (layer >= 0) & (layer < layers)
        band[layer[inside], column[inside]] = state[inside]
        below[column[(layer < 0) & (state == 1)]] = True
    verdict, floor = judge_columns(
        band, below, base, height, columns.shape, view.resolution, limits
    )
    fits = ~_near(verdict != Verdict.FREE, robot_radius / view.resolution)
    return Traversability(verdict, floor, fits, view.resolution, columns.origin)


def _check(limits: Limits, max_slope_deg: float, resolution: float) -> None:
    for name, value in (("robot_height", limits.height), ("robot_radius", limits.radius)):
        if not 0.0 < value < math.inf:
            raise ConfigError(f"{name} is a length above 0 [m], got {value}")
    if not resolution * (1.0 - 1e-9) <= limits.step < math.inf:
        raise ConfigError(
            f"max_step {limits.step:g} m is below the side of a cell, {resolution:g} m: lower "
            "steps cannot be told from the rounding to cells"
        )
    if not 0.0 < max_slope_deg < 90.0:
        raise ConfigError(f"max_slope_deg lies between 0 and 90, got {max_slope_deg}")


def _states(
    view: Belief | VoxelMap, limits: Thresholds
) -> Iterator[tuple[IntArray, npt.NDArray[np.uint8]]]:
    """The known cells, some at a time, and whether they are free 1, undecided 2, occupied 3."""
    parts = iter([view.cells()]) if isinstance(view, VoxelMap) else view.parts(sigmoid)
    for index, p in parts:
        state = np.full(len(p), 2, np.uint8)
        state[p <= limits.free], state[p >= limits.occupied] = 1, 3
        yield index, state


def _ground(view: Belief | VoxelMap, columns: Columns, limits: Thresholds) -> GroundSurface:
    occupied, free = columns.nowhere(), columns.nowhere()
    for index, state in _states(view, limits):
        columns.lower(occupied, index[state == 3])
        columns.lower(free, index[state == 1])
    lowest = columns.lowest_cells(occupied), columns.lowest_cells(free)
    return fit_ground_surface(lowest[0], view.resolution, lowest[1])


def _near(cells: BoolArray, radius: float) -> BoolArray:
    """Which cells have one of some within a radius [cells]; outside the map all are some."""
    from scipy.ndimage import distance_transform_edt

    away = distance_transform_edt(np.pad(~cells, 1, constant_values=False))
    return np.asarray(away[1:-1, 1:-1] <= radius)
