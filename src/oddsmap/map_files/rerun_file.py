# SPDX-License-Identifier: Apache-2.0
"""A map as a recording of Rerun (`.rrd`): a GridMap of a plane, VoxelGridMaps of occupied cells.

Source: https://rerun.io/docs/reference/types/archetypes, GridMap and VoxelGridMap; the rows of a
GridMap go down from the highest y, as rerun-sdk itself turns those of a nav_msgs/OccupancyGrid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError, InputError
from oddsmap.map_files.fields import CellPoints, Plane, PointPart
from oddsmap.map_files.grid_messages import check_plane_size, occupancy_values
from oddsmap.map_files.octomap_range import Shift
from oddsmap.map_files.plane import windows
from oddsmap.odds import Thresholds

__all__ = ["save_rerun_plane", "save_rerun_space"]

# Places are float32 there: a cell's corners are to be right to this part of its side.
_PART_OF_A_CELL = 1 / 16


def save_rerun_plane(
    plane: Plane, path: str | Path, *, shift: Shift | None = None, force: bool = False
) -> Path:
    """Write a 2D map as the GridMap `map`: 100 p, rounded, and 255 where unknown.

    Args:
        plane: the map.
        path: the file to write, named `.rrd`.
        shift: the corner of cells that becomes the origin; None: the map's own.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        ConfigError: rerun-sdk is not installed, or the suffix is another.
        InputError: the map has too many cells, or lies too far from the origin.
        OutputError: the file exists already or cannot be written.
    """
    path, rerun = _checked(path, force)
    check_plane_size(plane)
    ny, nx = plane.shape
    corner = np.array([*plane.origin, 0.0]) - _origin(shift)
    reach = math.hypot(*corner[:2]) + math.hypot(ny, nx) * plane.resolution
    _check_places(path, reach, corner + _origin(shift), plane.resolution)
    # From the top down; int8's -1 is 255.
    values = np.empty((ny, nx), np.int8)
    for rows, columns in windows((ny, nx)):
        part = plane.part(rows, columns)
        values[slice(*rows), slice(*columns)] = occupancy_values(part, "raw", Thresholds())
    grid = rerun.GridMap(
        data=values[::-1].tobytes(),
        format=rerun.components.ImageFormat(
            width=nx, height=ny, color_model="L", channel_datatype="U8"
        ),
        cell_size=plane.resolution,
        translation=corner,
        quaternion=[0.0, 0.0, math.sin(plane.yaw / 2), math.cos(plane.yaw / 2)],
        colormap=rerun.components.Colormap.RvizMap,
    )
    return _write(rerun, path, [("map", [grid])], force)


def save_rerun_space(
    cells: CellPoints,
    path: str | Path,
    *,
    thresholds: Thresholds | None = None,
    shift: Shift | None = None,
    force: bool = False,
) -> Path:
    """Write the occupied cells of a 3D map as the VoxelGridMap `map`, their values p(occupied).

    Larger leaves of an octree are VoxelGridMaps of their own: `map/x2` has those of two cells a
    side. Where the map has counts, `hits` and `passes` [votes] stand beside the values, float32.

    Args:
        cells: the map's cells, or leaves of an octree.
        path: the file to write, named `.rrd`.
        thresholds: the probability from which a cell counts as occupied; by default 0.65.
        shift: the corner of cells that becomes the origin; None: the map's own.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        ConfigError: rerun-sdk is not installed, or the suffix is another.
        InputError: the map lies too far from the origin.
        OutputError: the file exists already or cannot be written.
    """
    path, rerun = _checked(path, force)
    bounds = cells.bounds()
    if bounds is not None:
        low, high = (bound * np.float64(cells.resolution) for bound in bounds)
        reach = np.abs([low - _origin(shift), high - _origin(shift)]).max()
        _check_places(path, float(reach), low, cells.resolution)
    least = (thresholds or Thresholds()).occupied
    parts = [part for part in cells.points(least) if len(part.side)]
    return _write(rerun, path, _voxels(rerun, parts, cells.resolution, _origin(shift)), force)


def _voxels(
    rerun: Any, parts: list[PointPart], resolution: float, origin: FloatArray
) -> Iterator[tuple[str, list[Any]]]:
    """What to log: an entity for each size of cells."""
    if not parts:
        yield "map", [_voxel_grid(rerun, np.empty((0, 3)), np.empty(0), resolution)]
        return
    side = np.concatenate([part.side for part in parts])
    for length in np.unique(side):
        chosen = side == length
        centre = np.concatenate([part.centre for part in parts])[chosen] - origin
        p = np.concatenate([part.probability for part in parts])[chosen]
        logged = [_voxel_grid(rerun, centre, p, float(length))]
        if parts[0].hits is not None:
            counts = {
                name: np.concatenate([getattr(part, name) for part in parts])[chosen]
                for name in ("hits", "passes")
            }
            logged.append(
                rerun.AnyValues(**{name: n.astype(np.float32) for name, n in counts.items()})
            )
        times = round(length / resolution)
        yield "map" if times == 1 else f"map/x{times}", logged


def _voxel_grid(rerun: Any, centre: FloatArray, p: FloatArray, side: float) -> Any:
    # Leaves of one size lie on a lattice; a shift of whole cells may move it off the origin.
    corner = centre / side - 0.5
    first = corner[0] - np.rint(corner[0]) if len(corner) else np.zeros(3)
    index: npt.NDArray[np.int32] = np.rint(corner - first).astype(np.int32)
    return rerun.VoxelGridMap(
        index,
        voxel_size=[side] * 3,
        values=p.astype(np.float32),
        value_range=[0.0, 1.0],
        translation=first * side,
        colormap=rerun.components.Colormap.Viridis,
    )


def _origin(shift: Shift | None) -> FloatArray:
    return np.zeros(3) if shift is None else shift.metres


def _checked(path: str | Path, force: bool) -> tuple[Path, Any]:
    """The path and the package, before any work is done."""
    path = Path(path)
    if path.suffix.lower() != ".rrd":
        raise ConfigError(f"{path}: a recording of Rerun is named .rrd")
    try:
        rerun = import_module("rerun")
        rerun.VoxelGridMap  # noqa: B018 - another package of this name, or an old one
    except (ImportError, AttributeError):
        raise ConfigError(
            '.rrd is written with rerun-sdk 0.41 or later: pip install "oddsmap[rerun]"'
        ) from None
    check_output(path, force=force)
    return path, rerun


def _check_places(path: Path, reach: float, low: FloatArray, resolution: float) -> None:
    """Refuse a map whose cells would be drawn elsewhere: Rerun's places are float32."""
    off = float(np.spacing(np.float32(reach)))
    if off <= _PART_OF_A_CELL * resolution:
        return
    corner = np.floor(low / resolution) * resolution
    raise InputError(
        f"{path}: cells of {resolution:g} m lie {reach:.0f} m from the origin, where Rerun places "
        f"them to {off:.2g} m: say --shift {' '.join(f'{x:.10g}' for x in corner)}"
    )


def _write(
    rerun: Any, path: Path, entities: list[tuple[str, list[Any]]] | Iterator[Any], force: bool
) -> Path:
    recording = rerun.RecordingStream("oddsmap")
    # Written by us: its own thread only logs that a disk is full.
    stored = recording.memory_recording()
    recording.send_recording_name(path.stem)
    recording.log("/", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, strict=True)
    for name, logged in entities:
        recording.log(name, *logged, static=True, strict=True)
    content = stored.drain_as_bytes()
    with atomic_output(path, force=force) as part:
        part.write_bytes(content)
    return path
