# SPDX-License-Identifier: Apache-2.0
"""A map of probabilities without counts.

It is what a posterior gives to exports, and what a file without evidence (a ROS map) arrives as:
a prior, or something to compare with, never evidence.
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

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.cell_index import box_cells, cell_indices
from oddsmap.errors import InputError
from oddsmap.odds import Thresholds, decided_by
from oddsmap.plot.thumbnail import Pictured, Thumbnail, of_probability, shrunk
from oddsmap.query.places import check_places, points_in
from oddsmap.query.queries import PointStates, Queries
from oddsmap.query.scan_at_poses import Frame
from oddsmap.scans.note import Note
from oddsmap.short_repr import counted, described, extent_of, grid_facts

if TYPE_CHECKING:
    from typing import Unpack

    from matplotlib.axes import Axes

    from oddsmap.plot.on_axes import PlotOptions

__all__ = ["ProbabilityMap", "load_ros"]


@dataclass(frozen=True, slots=True, eq=False)
class ProbabilityMap(Queries, Pictured):
    """Probabilities of a rectangle of 2D cells, which count from its own corner.

    Args:
        probability: p(occupied), shape (ny, nx), row = y ascending, column = x ascending.
        observed: True where there was evidence, same shape.
        resolution: side of a cell [m].
        origin: position in the map frame of the lower left corner of cell (0, 0) [m].
        yaw: rotation of the grid about that corner [rad], counter-clockwise.
        notes: what to know before trusting it, where it was read from a file.

    Raises:
        InputError: shapes differ or the resolution is not positive.
    """

    probability: npt.NDArray[np.float64]
    observed: npt.NDArray[np.bool_]
    resolution: float
    origin: tuple[float, float] = (0.0, 0.0)
    yaw: float = 0.0
    notes: tuple[Note, ...] = ()

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        ny, nx = self.observed.shape
        yield from grid_facts(2, self.resolution, int(np.count_nonzero(self.observed)), None)
        yield f"{nx} x {ny} cells"
        if self.yaw == 0.0:
            yield extent_of(self.origin, np.add(self.origin, np.array([nx, ny]) * self.resolution))
        else:
            yield f"origin {self.origin[0]:.10g}, {self.origin[1]:.10g} m, yaw {self.yaw:.6g} rad"
        if self.notes:
            yield counted(len(self.notes), "note")

    def __post_init__(self) -> None:
        if self.probability.ndim != 2 or self.probability.shape != self.observed.shape:
            raise InputError(
                "a probability map needs two arrays of one shape (ny, nx), "
                f"got {self.probability.shape} and {self.observed.shape}"
            )
        if not 0.0 < self.resolution < float("inf"):
            raise InputError(f"a map needs a positive resolution [m], got {self.resolution}")

    @property
    def ndim(self) -> int:
        """2."""
        return 2

    def cell_of(self, points: npt.ArrayLike) -> IntArray:
        """The cells that hold points, (0, 0) at `origin`: see `oddsmap.query.places.Placed`."""
        turn, corner = self._frame()
        # Rows from the right: by the inverse.
        return check_places((points_in(points, 2) - corner) @ turn / self.resolution)

    def centre_of(self, cells: npt.ArrayLike) -> FloatArray:
        """The centres of cells, which count from `origin`: see `oddsmap.query.places.Placed`."""
        turn, corner = self._frame()
        centre: FloatArray = (cell_indices(cells, 2) + 0.5) * self.resolution @ turn.T + corner
        return centre

    def region_of(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> tuple[IntArray, IntArray]:
        """The cells of a box of metres, which count from `origin`: see `Placed.region_of`.

        Raises:
            InputError: as there, or the map is turned: its cells make no box along the axes.
        """
        if self.yaw != 0.0:
            raise InputError(f"the map is turned by {self.yaw:g} rad: its cells make no such box")
        low, high = (np.asarray(corner, np.float64) - self.origin for corner in (lo, hi))
        return box_cells(low, high, self.resolution, 2)

    def _map_from_cells(self) -> Frame:
        return self._frame()

    def _frame(self) -> tuple[FloatArray, FloatArray]:
        """map_from_grid: rotation and translation."""
        if self.yaw == 0.0:
            return np.eye(2), np.asarray(self.origin, np.float64)
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([[cos, -sin], [sin, cos]]), np.asarray(self.origin, np.float64)

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The rectangle's cells: first index, (0, 0), and past the last, shape (2,), x first."""
        ny, nx = self.probability.shape
        return (np.zeros(2, np.int64), np.array([nx, ny])) if nx and ny else None

    def _inside(self, cells: IntArray) -> tuple[npt.NDArray[np.bool_], tuple[IntArray, ...]]:
        """Which cells the rectangle has, and where these are in its arrays."""
        shape = np.array(self.probability.shape[::-1])
        inside = np.all((cells >= 0) & (cells < shape), axis=1)
        return inside, tuple(cells[inside].T[::-1])

    def _probability_at(self, cells: IntArray) -> FloatArray:
        p = np.full(len(cells), np.nan)
        inside, place = self._inside(cells)
        p[inside] = self.probability[place]
        return p

    def _states_at(self, cells: IntArray, thresholds: Thresholds | None) -> PointStates:
        p, observed = self._probability_at(cells), np.zeros(len(cells), np.bool_)
        inside, place = self._inside(cells)
        observed[inside] = self.observed[place]
        return PointStates(cells, p, decided_by(thresholds, Thresholds()).state(p, observed))

    def _state_parts(
        self, thresholds: Thresholds | None, within: Region | None = None
    ) -> Iterator[tuple[IntArray, npt.NDArray[np.int8]]]:
        y, x = np.nonzero(self.observed)
        yield np.stack([x, y], axis=1), self.state(thresholds=thresholds)[y, x]

    def _probability_parts(self) -> Iterator[tuple[IntArray, FloatArray]]:
        y, x = np.nonzero(self.observed)
        yield np.stack([x, y], axis=1), self.probability[y, x]

    def state(self, *, thresholds: Thresholds | None = None) -> npt.NDArray[np.int8]:
        """Decide each cell: values of `State`, shape (ny, nx).

        Args:
            thresholds: what is free and what is occupied; by default 0.196, 0.65.
        """
        return decided_by(thresholds, Thresholds()).state(self.probability, self.observed)

    def _thumbnail(self) -> Thumbnail | None:
        box = self.bounds()
        if box is None:
            return None
        y, x = np.nonzero(self.observed)
        parts = [(np.stack([x, y], axis=1), self.probability[y, x])]
        return of_probability(shrunk(parts, *box))

    def plot(self, ax: Axes | None = None, **options: Unpack[PlotOptions]) -> Axes:
        """Draw the map into axes of Matplotlib: see `oddsmap.plot.on_axes.plot_probability`.

        Args:
            ax: where; None: the current axes of pyplot.
            options: title, trajectory, crop, whole, colour_bar, cmap: see
                `oddsmap.plot.on_axes.PlotOptions`.
        """
        from oddsmap.plot.on_axes import plot_probability

        return plot_probability(self, ax, **options)

    def save_npz(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the observed cells as arrays, without counts: `oddsmap.map_files.npz.save_npz`.

        Indices count from the map's `origin`, which is written, too, as `x, y, yaw`: it need not
        be a corner of cells that count from (0, 0).
        """
        from oddsmap.map_files.npz import save_npz

        y, x = np.nonzero(self.observed)
        nothing = np.zeros(len(x))
        save_npz(
            Path(path),
            index=np.stack([x, y], axis=1),
            hits=nothing,
            passes=nothing,
            probability=self.probability[y, x],
            observed=np.ones(len(x), np.bool_),
            resolution=self.resolution,
            origin=(*self.origin, self.yaw),
            force=force,
        )


def load_ros(path: str | Path) -> ProbabilityMap:
    """Read a map_server map (YAML and PGM, PNG or another image that Pillow reads).

    Args:
        path: the `.yaml`; a relative `image` in it is looked for beside it.

    Returns:
        The map, unknown cells with `observed` False; for the probabilities see
        `oddsmap.map_files.ros_reader.read_greys`.

    Raises:
        InputError: a file is missing or not what it should be, or a key is missing or senseless.
    """
    from oddsmap.map_files.ros_reader import read_ros

    return ProbabilityMap(*read_ros(path)[:-1])  # all but the mode
