# SPDX-License-Identifier: Apache-2.0
"""What all maps of log odds can do, whichever estimator they come from."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.cell_index import cell_box
from oddsmap.errors import ConfigError, InputError
from oddsmap.map_files.fields import PlanePart, PointPart
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.odds import Thresholds, decided_by, sigmoid
from oddsmap.plot.thumbnail import Pictured, Thumbnail, of_probability, shrunk
from oddsmap.query.queries import PointStates, Queries
from oddsmap.short_repr import described, grid_facts

if TYPE_CHECKING:
    from typing import Unpack

    import xarray
    from matplotlib.axes import Axes

    from oddsmap.map_files.fields import Leaves, OfLogOdds, Plane
    from oddsmap.map_files.octomap_range import Shift
    from oddsmap.map_files.ros_reader import RosMode
    from oddsmap.maps.voxel_map import VoxelMap
    from oddsmap.plot.layout import FrameOptions
    from oddsmap.plot.on_axes import PlotOptions

__all__ = ["Belief", "Region"]


class Belief(Queries, Pictured, ABC):
    """p(m_i | z_1:t) of each cell, in 2D or 3D.

    Regions are pairs (lo, hi) of cell indices, x first, hi past the last cell; by default the
    box of known cells. Arrays have shape (ny, nx), row = y ascending; (nz, ny, nx) in 3D.

    Attributes:
        thresholds: the probabilities from which a cell counts as free or occupied.
        prior: p(x) of a cell that nothing is known of.
    """

    thresholds: Thresholds
    prior: float

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield from grid_facts(self.ndim, self.resolution, None, self.bounds())

    @property
    @abstractmethod
    def ndim(self) -> int:
        """2 for a 2D map, 3 for a 3D map."""

    @property
    @abstractmethod
    def resolution(self) -> float:
        """Side of a cell [m]."""

    @abstractmethod
    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of known cells: first index and past the last, shape (d,); None: no cells."""

    @abstractmethod
    def log_odds(self, region: Region | None = None) -> FloatArray:
        """Log odds of a region's cells; the prior's where nothing is known."""

    @abstractmethod
    def observed(self, region: Region | None = None) -> npt.NDArray[np.bool_]:
        """True for the cells that have been observed, also where p is the prior's."""

    @abstractmethod
    def known_log_odds(self) -> tuple[IntArray, FloatArray]:
        """The observed cells: index, shape (n, d), x first, and log odds, shape (n,)."""

    @abstractmethod
    def log_odds_at(self, index: npt.ArrayLike) -> FloatArray:
        """Log odds of single cells, shape (n,); the prior's where nothing is known.

        Args:
            index: cells, shape (n, d), x first.
        """

    @abstractmethod
    def observed_at(self, index: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """True for single cells that have been observed, shape (n,); index as in `log_odds_at`."""

    @abstractmethod
    def save_npz(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the observed cells as arrays: see `oddsmap.map_files.npz.save_npz`."""

    def probability(self, region: Region | None = None) -> FloatArray:
        """p(occupied) of a region's cells; the prior where nothing is known."""
        return sigmoid(self.log_odds(region))

    def state(
        self, region: Region | None = None, *, thresholds: Thresholds | None = None
    ) -> npt.NDArray[np.int8]:
        """Decide a region's cells: values of `oddsmap.State`.

        Args:
            region: (lo, hi); None: the box of known cells.
            thresholds: what is free and what is occupied; by default this view's.
        """
        box = self._region(region)
        limits = decided_by(thresholds, self.thresholds)
        return limits.state(self.probability(box), observed=self.observed(box))

    def cells(self) -> tuple[IntArray, FloatArray]:
        """The observed cells: index, shape (n, d), x first, and probability, shape (n,)."""
        index, log_odds = self.known_log_odds()
        return index, sigmoid(log_odds)

    def parts(
        self, function: OfLogOdds, *, z: tuple[int, int] | None = None
    ) -> Iterator[tuple[IntArray, npt.NDArray[Any]]]:
        """The observed cells, some at a time: index, shape (n, d), and a function of log odds.

        Args:
            function: element by element.
            z: layers of cells, first and past the last, outside which cells of a 3D map may be left
                out.
        """
        index, log_odds = self.known_log_odds()
        yield index, function(log_odds)

    @property
    def has_counts(self) -> bool:
        """Whether the view knows how many hits and passes a cell has had."""
        return False

    def part(self, region: Region) -> PlanePart:
        """A region's cells as files take them: probability, whether observed, and counts."""
        return PlanePart(self.probability(region), self.observed(region), None, None)

    def plane(self) -> Plane:
        """The box of known cells of a 2D map, for files that take it in parts.

        Raises:
            InputError: a 3D map.
        """
        from oddsmap.posterior.plane import BeliefPlane

        return BeliefPlane(self)

    def points(self, least: float) -> Iterator[PointPart]:
        """The observed cells of a 3D map as points, some at a time, of at least a probability.

        Raises:
            InputError: a 2D map.
        """
        self._check_space()
        for index, p in self.parts(sigmoid):
            chosen = p >= least
            yield self._points(index[chosen], p[chosen], None, None)

    def _points(
        self, index: IntArray, p: FloatArray, hits: FloatArray | None, passes: FloatArray | None
    ) -> PointPart:
        centre = np.asarray((index + 0.5) * self.resolution, np.float64)
        return PointPart(centre, np.full(len(p), self.resolution), p, hits, passes)

    def _check_space(self) -> None:
        if self.ndim != 3:
            raise InputError("an OctoMap, a PLY or a LAS needs a 3D map, this one is 2D")

    def to_probability_map(self, region: Region | None = None) -> ProbabilityMap:
        """Probabilities with their place in the world.

        Raises:
            InputError: a 3D map.
        """
        if self.ndim != 2:
            raise InputError(
                "a picture or a ROS map needs a 2D map, this one is 3D: "
                "oddsmap.project makes one of a band of heights (--z-min, --z-max)"
            )
        lo, hi = self._region(region)
        return ProbabilityMap(
            probability=self.probability((lo, hi)),
            observed=self.observed((lo, hi)),
            resolution=self.resolution,
            origin=(float(lo[0]) * self.resolution, float(lo[1]) * self.resolution),
        )

    def to_voxels(self) -> VoxelMap:
        """Log odds of the observed cells of a 3D map.

        Raises:
            InputError: a 2D map.
        """
        from oddsmap.maps.voxel_map import VoxelMap

        self._check_space()
        return VoxelMap(*self.known_log_odds(), self.resolution)

    def leaves(self, shift: Shift | None = None) -> Leaves:
        """The observed cells of a 3D map as leaves of an octree, for files.

        Args:
            shift: the cell that becomes cell 0; None: the map's own.

        Raises:
            InputError: a 2D map.
        """
        voxels = self.to_voxels()
        return voxels if shift is None else voxels.leaves(shift)

    def to_xarray(self, region: Region | None = None) -> xarray.DataArray:
        """Probabilities with coordinates of the cells' centres [m]; needs the extra `xarray`.

        A further coordinate, `observed`, tells cells that were seen from those that have the
        prior's probability: `array.where(array.observed)`.

        Raises:
            ConfigError: xarray is not installed.
        """
        try:
            import xarray
        except ImportError:
            raise ConfigError("xarray is not installed: pip install 'oddsmap[xarray]'") from None
        lo, hi = self._region(region)
        names = ("x", "y", "z")[: self.ndim]
        coords: dict[str, Any] = {
            name: (name, (np.arange(a, b) + 0.5) * self.resolution, {"units": "m"})
            for name, a, b in zip(names, lo, hi, strict=True)
        }
        coords["observed"] = (names[::-1], self.observed((lo, hi)))
        return xarray.DataArray(
            self.probability((lo, hi)),
            dims=names[::-1],
            coords=coords,
            name="probability",
            attrs={"resolution": self.resolution, **self._notes()},
        )

    def save_ros(
        self,
        path: str | os.PathLike[str],
        *,
        mode: RosMode = "trinary",
        force: bool = False,
    ) -> tuple[Path, Path]:
        """Write a ROS map_server map: see `oddsmap.map_files.ros_writer.save_ros`."""
        from oddsmap.map_files.ros_writer import save_ros

        return save_ros(
            self.to_probability_map(),
            Path(path),
            mode=mode,
            thresholds=self.thresholds,
            force=force,
        )

    def save_png(
        self,
        path: str | os.PathLike[str],
        *,
        force: bool = False,
        **options: Unpack[FrameOptions],
    ) -> None:
        """Draw the map as `.png`, `.pdf` or `.svg`: see `oddsmap.plot.picture.save_picture`.

        Args:
            path: the file to write.
            force: True where an existing file may be replaced.
            options: title, trajectory, crop, size, whole: see
                `oddsmap.plot.layout.FrameOptions`.
        """
        from oddsmap.plot.picture import save_picture

        save_picture(self.to_probability_map(), Path(path), force=force, **options)

    def _thumbnail(self) -> Thumbnail | None:
        box = self.bounds()
        if box is None:
            return None
        # Of a column the largest is seen.
        flat = ((index[:, :2], p) for index, p in self.parts(sigmoid))
        return of_probability(shrunk(flat, box[0][:2], box[1][:2]))

    def plot(self, ax: Axes | None = None, **options: Unpack[PlotOptions]) -> Axes:
        """Draw the map into axes of Matplotlib: see `oddsmap.plot.on_axes.plot_probability`.

        Args:
            ax: where; None: the current axes of pyplot.
            options: title, trajectory, crop, whole, colour_bar, cmap: see
                `oddsmap.plot.on_axes.PlotOptions`.
        """
        from oddsmap.plot.on_axes import plot_probability

        return plot_probability(self.to_probability_map(), ax, **options)

    def save_octomap(
        self,
        path: str | os.PathLike[str],
        *,
        clamp: tuple[float, float] | None = None,
        shift: tuple[float, float, float] | None = None,
        force: bool = False,
    ) -> None:
        """Write a `.bt` or `.ot`: see `oddsmap.map_files.octomap_writer.save_octomap`.

        Args:
            path: the file to write.
            clamp: lowest and highest probability written to an `.ot`; None: as they are.
            shift: the point of the map that becomes the file's origin [m], a whole number of cells
                from the map's; None: that itself.
            force: True where an existing file may be replaced.
        """
        from oddsmap.map_files.octomap_range import check_keys, shift_of
        from oddsmap.map_files.octomap_writer import save_octomap

        moved = None if shift is None else shift_of(shift, self.resolution)
        self._check_space()
        check_keys(Path(path), self.bounds(), self.resolution, moved)
        save_octomap(
            self.leaves(moved), Path(path), clamp=clamp, thresholds=self.thresholds, shift=moved,
            force=force,
        )  # fmt: skip

    def save_ply(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the occupied cells as points: see `oddsmap.map_files.ply.save_ply`."""
        from oddsmap.map_files.ply import save_ply

        save_ply(self, Path(path), thresholds=self.thresholds, force=force)

    def save_rosbag(
        self,
        path: str | os.PathLike[str],
        *,
        mode: RosMode = "trinary",
        frame: str = "map",
        stamp_ns: int = 0,
        shift: tuple[float, float, float] | None = None,
        force: bool = False,
    ) -> None:
        """Write messages of ROS: see `oddsmap.map_files.ros_bag.save_bag`.

        Args:
            path: named `.mcap`, `.bag` (of ROS 1), or without a suffix: the folder of a ROS 2 bag.
            mode: of a 2D map, see `oddsmap.map_files.grid_messages.occupancy_values`.
            frame: the frame of the map.
            stamp_ns: its time [ns]; 0 in ROS stands for the latest transforms.
            shift: of a 3D map, see `save_octomap`.
            force: True where an existing output may be replaced.
        """
        from oddsmap.map_files.grid_messages import plane_messages
        from oddsmap.map_files.octomap_range import check_keys, shift_of
        from oddsmap.map_files.ros_bag import kind_of_bag, save_bag
        from oddsmap.map_files.ros_messages import MapHeader
        from oddsmap.map_files.space_messages import space_messages

        path, header, limits = Path(path), MapHeader(frame, stamp_ns), self.thresholds
        if self.ndim == 2:
            make = plane_messages(self.plane(), mode=mode, thresholds=limits)
        else:
            moved = None if shift is None else shift_of(shift, self.resolution)
            check_keys(path, self.bounds(), self.resolution, moved)
            make = space_messages(self.leaves(moved), self, thresholds=limits, shift=moved)
        save_bag(make, path, kind_of_bag(path), header=header, force=force)

    def save_las(
        self, path: str | os.PathLike[str], *, crs: str | None = None, force: bool = False
    ) -> None:
        """Write the occupied cells as LAS or LAZ: see `oddsmap.map_files.las.save_las`."""
        from oddsmap.map_files.las import save_las

        self._check_space()
        save_las(self, Path(path), crs=crs, thresholds=self.thresholds, force=force)

    def save_rerun(
        self,
        path: str | os.PathLike[str],
        *,
        shift: tuple[float, float, float] | None = None,
        force: bool = False,
    ) -> None:
        """Write a recording of Rerun: see `oddsmap.map_files.rerun_file`.

        Args:
            path: the file to write, named `.rrd`.
            shift: the point of the map that becomes the file's origin [m], a whole number of cells
                from the map's; None: that itself.
            force: True where an existing file may be replaced.
        """
        from oddsmap.map_files.octomap_range import shift_of
        from oddsmap.map_files.rerun_file import save_rerun_plane, save_rerun_space

        moved = None if shift is None else shift_of(shift, self.resolution)
        if self.ndim == 2:
            save_rerun_plane(self.plane(), Path(path), shift=moved, force=force)
        else:
            save_rerun_space(self, Path(path), thresholds=self.thresholds, shift=moved, force=force)

    def save_geotiff(
        self, path: str | os.PathLike[str], *, crs: str | None = None, force: bool = False
    ) -> None:
        """Write a 2D map as a GeoTIFF: see `oddsmap.map_files.geotiff.save_geotiff`."""
        from oddsmap.map_files.geotiff import save_geotiff

        save_geotiff(self.plane(), Path(path), crs=crs, force=force)

    def _probability_at(self, cells: IntArray) -> FloatArray:
        return sigmoid(self.log_odds_at(cells))

    def _states_at(self, cells: IntArray, thresholds: Thresholds | None) -> PointStates:
        p = sigmoid(self.log_odds_at(cells))
        state = decided_by(thresholds, self.thresholds).state(p, self.observed_at(cells))
        return PointStates(cells, p, state)

    def _state_parts(
        self, thresholds: Thresholds | None, within: Region | None = None
    ) -> Iterator[tuple[IntArray, npt.NDArray[np.int8]]]:
        limits = decided_by(thresholds, self.thresholds)
        return self.parts(lambda x: limits.state(sigmoid(x), np.ones(x.shape, np.bool_)))

    def _probability_parts(self) -> Iterator[tuple[IntArray, FloatArray]]:
        return self.parts(sigmoid)

    def _notes(self) -> dict[str, object]:
        """What else a reader of an exported array should know."""
        return {}

    def _region(self, region: Region | None) -> tuple[IntArray, IntArray]:
        if region is not None:
            return cell_box(*region, self.ndim)
        bounds = self.bounds()
        if bounds is None:
            nothing = np.zeros(self.ndim, np.int64)
            return nothing, nothing
        return bounds
