# SPDX-License-Identifier: Apache-2.0
"""A plane as messages: `nav_msgs/OccupancyGrid`, and `foxglove_msgs/Grid` with all that is known.

An OccupancyGrid has one whole number a cell. What map_server publishes of a map that `save_ros`
wrote in one of its modes is the same as what is made here in that mode. The Grid has the
probability and the counts, which Foxglove shows as colours, and when a cell is clicked on.

Source: nav_msgs/OccupancyGrid; Nav2, nav2_map_server/src/map_io.cpp (loadMapFromFile);
https://docs.foxglove.dev/docs/visualization/message-schemas/grid
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.limits import memory_limit
from oddsmap.map_files.fields import Plane, PlanePart
from oddsmap.map_files.plane import windows
from oddsmap.map_files.ros_messages import MapMessages, RosMessages, TopicMessage
from oddsmap.map_files.ros_reader import RosMode
from oddsmap.odds import State, Thresholds

__all__ = [
    "MOST_GRID_CELLS",
    "cell_grid",
    "cell_type",
    "check_plane_size",
    "grid_messages",
    "has_cell_grid",
    "occupancy_grid",
    "occupancy_values",
    "packed_fields",
    "plane_messages",
]

# A message lists its cells by a number of 32 bits, and is held four times while it is written.
_MOST_CELLS = (1 << 31) - 1
_BYTES_A_CELL = 4

MOST_GRID_CELLS = 1 << 24
"""Cells up to which a `foxglove_msgs/Grid` is made: 256 MB; browsers draw 4096 x 4096 at most."""

_CELL = np.dtype(
    [
        ("probability", "<f4"), ("hits", "<f4"), ("passes", "<f4"),
        ("red", "u1"), ("green", "u1"), ("blue", "u1"), ("alpha", "u1"),
    ]
)  # fmt: skip
_UINT8, _FLOAT32 = 1, 7


def plane_messages(
    plane: Plane, *, mode: RosMode, thresholds: Thresholds
) -> Callable[[RosMessages], Iterator[TopicMessage]]:
    """What makes the messages of a 2D map: see `occupancy_grid` and `cell_grid`.

    Args:
        plane: the map.
        mode: what the OccupancyGrid says, see `occupancy_values`.
        thresholds: what is free and what is occupied in it.
    """

    def make(messages: RosMessages) -> Iterator[TopicMessage]:
        yield occupancy_grid(plane, messages, mode=mode, thresholds=thresholds)
        if messages.version == 2 and has_cell_grid(plane):
            yield cell_grid(plane, messages)

    return make


def check_plane_size(plane: Plane) -> None:
    """Refuse a map that has too many cells for a message, or for memory.

    Raises:
        InputError: it has.
    """
    ny, nx = plane.shape
    most = min(_MOST_CELLS, memory_limit() // _BYTES_A_CELL)
    if ny * nx > most:
        raise InputError(
            f"a map of {nx} x {ny} cells, and a message holds {most} of them here: make it of a "
            "coarser map, or crop it"
        )


def has_cell_grid(plane: Plane) -> bool:
    """Whether a map is small enough for a `foxglove_msgs/Grid`."""
    return plane.shape[0] * plane.shape[1] <= MOST_GRID_CELLS


def occupancy_values(
    part: PlanePart, mode: RosMode, thresholds: Thresholds
) -> npt.NDArray[np.int8]:
    """What an OccupancyGrid says of cells: -1 unknown, 0 free to 100 occupied.

    - trinary: 0 free, 100 occupied, -1 between the thresholds, too.
    - scale: the same, and 1 to 99 between the thresholds: 100 p, rounded.
    - raw: 100 p, rounded, in all cells that were seen. Nav2's planners take 100 alone for an
      obstacle, and with their default settings all others for free.

    Args:
        part: the cells.
        mode: which of them.
        thresholds: what is free and what is occupied.
    """
    if not part.observed.any():
        return np.full(part.observed.shape, -1, np.int8)
    percent = np.rint(100.0 * np.where(part.observed, part.probability, 0.0))
    if mode == "raw":
        values = percent
    else:
        state = thresholds.state(part.probability, part.observed)
        between = np.clip(percent, 1, 99) if mode == "scale" else -1
        values = np.where(state == State.UNDECIDED, between, state)
    return np.where(part.observed, values, -1).astype(np.int8)


def occupancy_grid(
    plane: Plane, messages: RosMessages, *, mode: RosMode, thresholds: Thresholds
) -> TopicMessage:
    """A map as a `nav_msgs/OccupancyGrid` on /map.

    Raises:
        InputError: it has too many cells for a message, or for memory.
    """
    check_plane_size(plane)
    ny, nx = plane.shape
    values = np.empty((ny, nx), np.int8)
    for rows, columns in windows((ny, nx)):
        part = plane.part(rows, columns)
        values[slice(*rows), slice(*columns)] = occupancy_values(part, mode, thresholds)
    info = messages.make(
        "nav_msgs/MapMetaData", messages.stamp(), float(plane.resolution), nx, ny,
        _pose(plane, messages),
    )  # fmt: skip
    message = messages.make("nav_msgs/OccupancyGrid", messages.header(), info, values.ravel())
    return TopicMessage("/map", "nav_msgs/msg/OccupancyGrid", message)


def cell_grid(plane: Plane, messages: MapMessages) -> TopicMessage:
    """A map as a `foxglove_msgs/Grid` on /map_cells: probability, hits, passes, and a colour.

    The probability is NaN in unknown cells, which are transparent. hits and passes are left out
    where the map has no counts.
    """
    ny, nx = plane.shape
    kind = cell_type(plane.has_counts)
    cells = np.zeros((ny, nx), kind)
    for rows, columns in windows((ny, nx)):
        _fill(cells[slice(*rows), slice(*columns)], plane.part(rows, columns))
    message = messages.make(
        "foxglove_msgs/Grid", messages.stamp(), messages.frame, _pose(plane, messages), nx,
        messages.make("foxglove_msgs/Vector2", plane.resolution, plane.resolution),
        nx * kind.itemsize, kind.itemsize, packed_fields(kind, messages),
        cells.reshape(-1).view(np.uint8),
    )  # fmt: skip
    return TopicMessage("/map_cells", "foxglove_msgs/msg/Grid", message)


def grid_messages(plane: Plane) -> Callable[[MapMessages], Iterator[TopicMessage]]:
    """What makes the Grid of a 2D map alone: see `cell_grid`.

    Raises:
        InputError: it has too many cells.
    """
    if not has_cell_grid(plane):
        raise InputError(
            f"a map of {plane.shape[1]} x {plane.shape[0]} cells, and a Grid lists "
            f"{MOST_GRID_CELLS:,} at most: make it of a coarser map or crop it, or export an .mcap "
            "without --format foxglove, which has an OccupancyGrid"
        )
    return lambda messages: iter([cell_grid(plane, messages)])


def cell_type(has_counts: bool) -> np.dtype[np.void]:
    """The fields of a cell of a Grid or VoxelGrid, one after the other."""
    counts = ("hits", "passes")
    kept = [name for name in _CELL.names or () if has_counts or name not in counts]
    return np.dtype([(name, _CELL[name]) for name in kept])


def packed_fields(kind: np.dtype[np.void], messages: MapMessages) -> list[Any]:
    """The same as `foxglove_msgs/PackedElementField`s."""
    names = kind.names or ()
    sizes = [kind[name].itemsize for name in names]
    return [
        messages.make(
            "foxglove_msgs/PackedElementField", name, sum(sizes[:k]),
            _UINT8 if kind[name] == np.uint8 else _FLOAT32,
        )
        for k, name in enumerate(names)
    ]  # fmt: skip


def _fill(cells: npt.NDArray[np.void], part: PlanePart) -> None:
    seen = part.observed
    cells["probability"] = np.where(seen, part.probability, np.nan)
    if part.hits is not None:
        cells["hits"], cells["passes"] = part.hits, part.passes
    brightness = np.where(seen, np.rint(255.0 * (1.0 - part.probability)), 0.0).astype(np.uint8)
    for colour in ("red", "green", "blue"):
        cells[colour] = brightness
    cells["alpha"] = np.where(seen, 255, 0)


def _pose(plane: Plane, messages: MapMessages) -> Any:
    x, y = plane.origin
    turn = math.sin(plane.yaw / 2), math.cos(plane.yaw / 2)
    place = messages.make("geometry_msgs/Point", x, y, 0.0)
    return messages.make(
        "geometry_msgs/Pose", place, messages.make("geometry_msgs/Quaternion", 0.0, 0.0, *turn)
    )
