# SPDX-License-Identifier: Apache-2.0
"""A 3D map as `foxglove_msgs/VoxelGrid`: the box of known cells, with all that is known of each.

Source: https://docs.foxglove.dev/docs/sdk/schemas/voxel-grid
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.map_files.fields import CellPoints, PointPart
from oddsmap.map_files.grid_messages import MOST_GRID_CELLS, cell_type, packed_fields
from oddsmap.map_files.ros_messages import MapMessages, TopicMessage
from oddsmap.odds import Thresholds

__all__ = ["voxel_messages"]


def voxel_messages(
    cells: CellPoints, *, thresholds: Thresholds
) -> Callable[[MapMessages], Iterator[TopicMessage]]:
    """What makes the VoxelGrid of a 3D map, on /map_voxels.

    The fields of a cell are those of a `foxglove_msgs/Grid`, see
    `oddsmap.map_files.grid_messages.cell_grid`. Occupied cells are grey, all others transparent.

    Args:
        cells: the map's cells, or leaves of an octree.
        thresholds: what is occupied.

    Raises:
        InputError: the map is empty, or its box has too many cells.
    """
    bounds = cells.bounds()
    if bounds is None:
        raise InputError("the map has no cells, nothing to write")
    low, high = bounds
    shape = tuple(int(n) for n in (high - low)[::-1])
    count = int(np.prod(shape, dtype=object))
    if count > MOST_GRID_CELLS:
        raise InputError(
            f"a box of {shape[2]} x {shape[1]} x {shape[0]} cells, and a VoxelGrid lists all of "
            f"them, {MOST_GRID_CELLS:,} at most: make it of a coarser map or crop it, or "
            "export an .mcap without --format foxglove, which has OctoMaps and points"
        )

    def make(messages: MapMessages) -> Iterator[TopicMessage]:
        grid = np.zeros(count, cell_type(cells.has_counts))
        grid["probability"] = np.nan
        for part in cells.points(0.0):
            _fill(grid, part, low, shape, cells.resolution, thresholds)
        side, kind = float(cells.resolution), grid.dtype
        corner = messages.make("geometry_msgs/Point", *(float(x) for x in low * np.float64(side)))
        turn = messages.make("geometry_msgs/Quaternion", 0.0, 0.0, 0.0, 1.0)
        _, ny, nx = shape
        row = nx * kind.itemsize
        message = messages.make(
            "foxglove_msgs/VoxelGrid", messages.stamp(), messages.frame,
            messages.make("geometry_msgs/Pose", corner, turn), ny, nx,
            messages.make("geometry_msgs/Vector3", side, side, side), ny * row, row, kind.itemsize,
            packed_fields(kind, messages), grid.view(np.uint8),
        )  # fmt: skip
        yield TopicMessage("/map_voxels", "foxglove_msgs/msg/VoxelGrid", message)

    return make


def _fill(
    grid: npt.NDArray[np.void],
    part: PointPart,
    low: IntArray,
    shape: tuple[int, ...],
    resolution: float,
    thresholds: Thresholds,
) -> None:
    """Enter some leaves, each in all cells that it has."""
    times = np.rint(part.side / resolution).astype(np.int64)
    lowest = np.rint(part.centre / resolution - times[:, None] / 2).astype(np.int64) - low
    grey = np.rint(255.0 * (1.0 - part.probability)).astype(np.uint8)
    alpha = np.where(part.probability >= thresholds.occupied, 255, 0)
    for size in np.unique(times):
        chosen = np.flatnonzero(times == size)
        for step in np.ndindex(size, size, size):
            x, y, z = (lowest[chosen] + step).T
            at = (z * shape[1] + y) * shape[2] + x
            grid["probability"][at] = part.probability[chosen]
            if part.hits is not None and part.passes is not None:
                grid["hits"][at], grid["passes"][at] = part.hits[chosen], part.passes[chosen]
            for colour in ("red", "green", "blue"):
                grid[colour][at] = grey[chosen]
            grid["alpha"][at] = alpha[chosen]
