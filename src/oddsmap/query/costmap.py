# SPDX-License-Identifier: Apache-2.0
"""Costs of Nav2's costmaps: obstacles, and what is near them, by Nav2's formulas.

A cell at distance d [m] from the nearest lethal cell, centre to centre, costs

    254                                                  d = 0
    253                                                  d <= inscribed_radius
    floor(252 exp(-cost_scaling_factor (d - inscribed_radius)))
                                                         d <= ceil(inflation_radius / resolution)
                                                              * resolution
    0                                                    beyond

and 255 where nothing is known. Nav2 spreads the nearest obstacle from cell to neighbouring cell,
which is not always the nearest one; here distances are exact.

Source: Nav2, nav2_costmap_2d: inflation_layer.hpp (computeCost), inflation_layer.cpp (updateCosts),
costmap_2d_publisher.cpp (the table of occupancy values), cost_values.hpp.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.cell_index import check_room
from oddsmap.errors import ConfigError, InputError
from oddsmap.odds import State, Thresholds
from oddsmap.plot.thumbnail import Pictured, Thumbnail, of_quantity
from oddsmap.query.boxes import Box
from oddsmap.query.distance_field import box_given
from oddsmap.query.given_numbers import check_numbers, check_threads
from oddsmap.query.obstacles import View
from oddsmap.query.places import Framed
from oddsmap.query.squared_distances import squared_to
from oddsmap.short_repr import described, extent_of, grid_facts, in_bytes

if TYPE_CHECKING:
    from typing import Unpack

    from matplotlib.axes import Axes

    from oddsmap.plot.on_axes import PlotOptions

__all__ = ["Costmap", "inflate", "make_costmap"]

Costs = npt.NDArray[np.uint8]

_MOST_CELLS = 4096
"""The widest inflation: its costs by squared distance are a table of 16 million."""
# Costs, whether lethal, squared distances, and their costs.
_BYTES = 12


@dataclass(frozen=True, slots=True, eq=False)
class Costmap(Framed, Pictured):
    """Costs of a box of 2D cells, as Nav2's planners read them.

    Attributes:
        cost: 0 free to 252, `INSCRIBED`, `LETHAL`, `NO_INFORMATION`; shape (ny, nx), row = y
            ascending.
        resolution: side of a cell [m].
        lo: the cell of `cost[0, 0]`, shape (2,), x first.
        map_from_cells: where the map's cells count from, if not from the map frame: rotation, shape
            (2, 2), and translation [m], shape (2,).
    """

    FREE: ClassVar[int] = 0
    INSCRIBED: ClassVar[int] = 253
    LETHAL: ClassVar[int] = 254
    NO_INFORMATION: ClassVar[int] = 255

    cost: Costs
    resolution: float
    lo: IntArray
    map_from_cells: tuple[FloatArray, FloatArray] | None = None

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield from grid_facts(2, self.resolution, None, None)
        ny, nx = self.cost.shape
        if self.map_from_cells is None:
            yield extent_of(self.origin, np.add(self.origin, np.array([nx, ny]) * self.resolution))
        else:
            x, y = self.origin
            yield f"{nx} x {ny} cells, origin {x:.10g}, {y:.10g} m, yaw {self.yaw:.6g} rad"
        yield in_bytes(self.cost.nbytes)

    @property
    def ndim(self) -> int:
        """2."""
        return 2

    @property
    def origin(self) -> tuple[float, float]:
        """The lower left corner of `cost[0, 0]` in the map frame [m]."""
        turn, corner = self.map_from_cells or (np.eye(2), np.zeros(2))
        x, y = turn @ (self.lo * self.resolution) + corner
        return float(x), float(y)

    @property
    def yaw(self) -> float:
        """Rotation of the cells about that corner [rad], counter-clockwise."""
        return (
            0.0
            if self.map_from_cells is None
            else math.atan2(self.map_from_cells[0][1, 0], self.map_from_cells[0][0, 0])
        )

    @property
    def occupancy(self) -> npt.NDArray[np.int8]:
        """The values with which Nav2 publishes costs as a nav_msgs/OccupancyGrid.

        0 for 0, 1 to 98 for 1 to 252, 99 for 253, 100 for 254, -1 for 255.
        """
        table = np.zeros(256, np.int8)
        middle = np.arange(1, self.INSCRIBED)
        table[middle] = 1 + 97 * (middle - 1) // 251
        table[self.INSCRIBED], table[self.LETHAL], table[self.NO_INFORMATION] = 99, 100, -1
        return table[self.cost]

    def at(self, points: npt.ArrayLike) -> Costs:
        """Costs at points; `NO_INFORMATION` outside the box.

        Args:
            points: in the map frame [m], shape (n, 2).

        Raises:
            InputError: another shape, or coordinates that are not finite or farther than 2^46 cells
                from the map's origin.
        """
        cells = self.cell_of(points)
        place, found = cells - self.lo, np.full(len(cells), self.NO_INFORMATION, np.uint8)
        inside = ((place >= 0) & (place < self.cost.shape[::-1])).all(axis=1)
        found[inside] = self.cost[tuple(place[inside].T[::-1])]
        return found

    def _thumbnail(self) -> Thumbnail | None:
        cost = np.where(self.cost == self.NO_INFORMATION, np.nan, self.cost.astype(np.float64))
        return of_quantity(cost, "cost", (0.0, float(self.LETHAL))) if cost.size else None

    def plot(self, ax: Axes | None = None, **options: Unpack[PlotOptions]) -> Axes:
        """Draw costs into axes of Matplotlib: see `oddsmap.plot.on_axes.plot_quantity`.

        Args:
            ax: where; None: the current axes of pyplot.
            options: title, trajectory, crop, whole, colour_bar, cmap: see
                `oddsmap.plot.on_axes.PlotOptions`.
        """
        from oddsmap.plot.layout import Cells
        from oddsmap.plot.on_axes import plot_quantity

        known = self.cost != self.NO_INFORMATION
        cells = Cells(self.cost.astype(np.float64), known, self.resolution, self.origin, self.yaw)
        label = f"cost ({self.INSCRIBED} inscribed, {self.LETHAL} lethal)"
        return plot_quantity(cells, ax, label=label, limits=(0.0, float(self.LETHAL)), **options)

    def save_ros(self, path: str | os.PathLike[str], *, force: bool = False) -> tuple[Path, Path]:
        """Write a map for ROS's map_server, mode raw: it publishes what `occupancy` holds.

        Args:
            path: the `.yaml`; the image is `path` with the suffix `.pgm`.
            force: True where existing files may be replaced.

        Returns:
            The paths of the YAML and of the image.

        Raises:
            InputError: the box has no cells.
            OutputError: a file exists already or cannot be written.
        """
        from oddsmap.map_files.ros_writer import save_ros

        return save_ros(_OccupancyGrid(self), Path(path), mode="raw", force=force)


@dataclass(frozen=True, slots=True)
class _OccupancyGrid:
    """A costmap as a map of probabilities: hundredths are the values that Nav2 publishes."""

    costmap: Costmap

    @property
    def probability(self) -> FloatArray:
        return self.costmap.occupancy / 100.0

    @property
    def observed(self) -> npt.NDArray[np.bool_]:
        return np.asarray(self.costmap.cost != Costmap.NO_INFORMATION)

    @property
    def resolution(self) -> float:
        return self.costmap.resolution

    @property
    def origin(self) -> tuple[float, float]:
        return self.costmap.origin

    @property
    def yaw(self) -> float:
        return self.costmap.yaw


def inflate(
    cost: npt.ArrayLike,
    resolution: float,
    *,
    inscribed_radius: float,
    inflation_radius: float = 0.55,
    cost_scaling_factor: float = 10.0,
    inflate_unknown: bool = False,
    inflate_around_unknown: bool = False,
    threads: int = 1,
) -> Costs:
    """Costs around lethal cells, as Nav2's inflation layer adds them.

    Args:
        cost: 0 to 252, 253 inscribed, 254 lethal, 255 unknown; whole numbers, shape (ny, nx).
        resolution: side of a cell [m].

    Other Args:
        inscribed_radius: of the largest circle in the robot's footprint about its centre [m]: a
            centre so near an obstacle is a collision.
        inflation_radius: where costs around obstacles end [m]; rounded up to whole cells.
        cost_scaling_factor: how fast they fall off [1/m].
        inflate_unknown: True: unknown cells get any cost above 0; False: only that of a collision.
        inflate_around_unknown: True: unknown cells are lethal.
        threads: how many; the result is the same.

    Returns:
        The larger of the cost that a cell has and of the one that it gets, another array.

    Raises:
        InputError: no such array of costs, or no such resolution.
        ConfigError: another parameter is outside its range.
    """
    costs = np.asarray(cost)
    if costs.ndim != 2 or costs.dtype.kind not in "iu":
        raise InputError(
            f"costs are whole numbers of shape (ny, nx), got {costs.dtype} {costs.shape}"
        )
    if costs.size and not 0 <= int(costs.min()) <= int(costs.max()) <= Costmap.NO_INFORMATION:
        raise InputError(f"costs are 0 to 255, got {costs.min()} to {costs.max()}")
    check_numbers(resolution=resolution)
    if not 0.0 < resolution < math.inf:
        raise InputError(f"a map needs a positive resolution [m], got {resolution}")
    table = _by_distance(resolution, inscribed_radius, inflation_radius, cost_scaling_factor)
    check_threads(threads)
    old = costs.astype(np.uint8)
    lethal = old == Costmap.LETHAL
    if inflate_around_unknown:
        lethal |= old == Costmap.NO_INFORMATION
    box = Box(np.zeros(2, np.int64), np.array(old.shape[::-1], np.int64))
    squared = squared_to(lethal.view(np.uint8), box, box, len(table) - 2, np.int32, threads)
    new = table[np.minimum(squared, len(table) - 1)]
    least = 1 if inflate_unknown else Costmap.INSCRIBED
    replaced = (old == Costmap.NO_INFORMATION) & (new >= least)
    return np.where(replaced, new, np.maximum(old, new))


def _by_distance(
    resolution: float, inscribed_radius: float, inflation_radius: float, scaling: float
) -> Costs:
    """Costs by squared distance [cells^2]; the last one is of those beyond the inflation radius."""
    for name, value in (
        ("inscribed_radius", inscribed_radius),
        ("inflation_radius", inflation_radius),
        ("cost_scaling_factor", scaling),
    ):
        check_numbers(**{name: value})
        if not 0.0 <= value < math.inf:
            raise ConfigError(f"{name} is at least 0 and finite, got {value}")
    if inflation_radius < inscribed_radius:
        raise ConfigError(
            f"inflation_radius {inflation_radius:g} m is less than inscribed_radius "
            f"{inscribed_radius:g} m: cells in which the robot collides would be free; give "
            "a larger inflation_radius"
        )
    cells = math.ceil(inflation_radius / resolution)
    if cells > _MOST_CELLS:
        raise ConfigError(
            f"inflation_radius {inflation_radius:g} m is {cells} cells, at most {_MOST_CELLS}: "
            "is it in metres?"
        )
    # In Nav2's order of operations: whether 3 cells of 0.1 m lie within 0.3 m is decided alike.
    distance = np.sqrt(np.arange(cells * cells + 2, dtype=np.float64)) * resolution
    falling = 252.0 * np.exp(-1.0 * scaling * (distance - inscribed_radius))
    near = distance <= inscribed_radius
    falling[near] = Costmap.INSCRIBED
    table = falling.astype(np.uint8)
    table[0], table[-1] = Costmap.LETHAL, Costmap.FREE
    return table


def make_costmap(
    view: View,
    box: Region | None,
    region: Region | None,
    *,
    inscribed_radius: float,
    inflation_radius: float,
    cost_scaling_factor: float,
    inflate_unknown: bool,
    inflate_around_unknown: bool,
    thresholds: Thresholds | None,
    threads: int,
) -> Costmap:
    """Costs of a view: see `DistanceQueries.costmap`."""
    if view.ndim != 2:
        raise InputError(
            "a costmap needs a 2D map, this one is 3D: oddsmap.project makes one of a band of "
            "heights; distance_field answers in 3D"
        )
    wanted, bounds = box_given(view, box, region), view.bounds()
    if wanted is None and bounds is None:
        raise InputError("the map has no known cells: say with box= what costs are of")
    known = None if bounds is None else Box(*bounds)
    nothing = np.zeros(2, np.int64)
    answered = wanted or known or Box(nothing, nothing)
    # Obstacles outside the box cost something inside it, too.
    reach = len(_by_distance(view.resolution, inscribed_radius, inflation_radius, 0.0)) - 2
    around = answered.wider(math.isqrt(reach))
    check_room(around.lo, around.hi, _BYTES)
    costs = inflate(
        costs_of(view, around, thresholds), view.resolution, inscribed_radius=inscribed_radius,
        inflation_radius=inflation_radius, cost_scaling_factor=cost_scaling_factor,
        inflate_unknown=inflate_unknown, inflate_around_unknown=inflate_around_unknown,
        threads=threads,
    )  # fmt: skip
    cost = np.ascontiguousarray(costs[answered.inside(around)])
    return Costmap(cost, view.resolution, answered.lo.copy(), view._map_from_cells())


def costs_of(view: View, box: Box, thresholds: Thresholds | None) -> Costs:
    """Costs before inflation: lethal where occupied, 0 where free, else unknown."""
    table = np.full(256, Costmap.NO_INFORMATION, np.uint8)
    table[State.FREE], table[State.OCCUPIED] = Costmap.FREE, Costmap.LETHAL
    return view._state_marks(table, thresholds, (box.lo, box.hi))
