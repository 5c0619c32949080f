# SPDX-License-Identifier: Apache-2.0
"""A 3D map as messages, on the topics of octomap_server: OctoMaps, and the occupied cells.

Source: octomap_msgs/Octomap and octomap_msgs/conversions.h: the data are those of a `.bt` or `.ot`
without the header; sensor_msgs/PointCloud2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from io import BytesIO

import numpy as np
import numpy.typing as npt

from oddsmap.map_files.fields import CellPoints, Leaves
from oddsmap.map_files.octomap_range import Shift
from oddsmap.map_files.octomap_writer import write_nodes
from oddsmap.map_files.ros_messages import RosMessages, TopicMessage, check_data
from oddsmap.odds import Thresholds

__all__ = ["octomap_message", "point_message", "space_messages"]

_FLOAT32 = 7


def space_messages(
    leaves: Leaves, cells: CellPoints, *, thresholds: Thresholds, shift: Shift | None = None
) -> Callable[[RosMessages], Iterator[TopicMessage]]:
    """What makes the messages of a 3D map: see `octomap_message` and `point_message`.

    Args:
        leaves: the map's, within OctoMap's keys.
        cells: the map's.
        thresholds: what is free and what is occupied.
        shift: by what the leaves are shifted, and the points will be.
    """
    origin = np.zeros(3) if shift is None else shift.metres

    def make(messages: RosMessages) -> Iterator[TopicMessage]:
        for binary in (True, False):
            yield octomap_message(leaves, messages, binary=binary, thresholds=thresholds)
        yield point_message(cells, messages, thresholds=thresholds, origin=origin)

    return make


def octomap_message(
    leaves: Leaves, messages: RosMessages, *, binary: bool, thresholds: Thresholds
) -> TopicMessage:
    """A map as `octomap_msgs/Octomap`: free and occupied, or log odds.

    Args:
        leaves: the map's, within OctoMap's keys.
        messages: makes them.
        binary: True for /octomap_binary (as in a `.bt`), False for /octomap_full (as in an `.ot`).
        thresholds: what is free and what is occupied in the former.
    """
    file = BytesIO()
    write_nodes(leaves, file, binary=binary, thresholds=thresholds)
    topic = "/octomap_binary" if binary else "/octomap_full"
    data = np.frombuffer(file.getbuffer(), np.int8)
    check_data(topic, data.nbytes)
    message = messages.make(
        "octomap_msgs/Octomap", messages.header(), binary, "OcTree", float(leaves.resolution), data
    )
    return TopicMessage(topic, "octomap_msgs/msg/Octomap", message)


def point_message(
    cells: CellPoints,
    messages: RosMessages,
    *,
    thresholds: Thresholds,
    origin: npt.NDArray[np.float64],
) -> TopicMessage:
    """The occupied cells as `sensor_msgs/PointCloud2` on /octomap_point_cloud_centers.

    Fields are x, y, z, size [m] and probability, and where the map has counts hits and passes
    [votes], all float32. Within OctoMap's keys that places a centre to 1/256 of a cell.

    Args:
        cells: the map's.
        messages: makes them.
        thresholds: what is occupied.
        origin: the point of the map from which coordinates count [m], shape (3,).
    """
    names = ["x", "y", "z", "size", "probability"]
    names += ["hits", "passes"] if cells.has_counts else []
    kind = np.dtype([(name, "<f4") for name in names])
    parts = []
    for some in cells.points(thresholds.occupied):
        points = np.empty(len(some.side), kind)
        for axis, name in enumerate("xyz"):
            points[name] = some.centre[:, axis] - origin[axis]
        points["size"], points["probability"] = some.side, some.probability
        if some.hits is not None:
            points["hits"], points["passes"] = some.hits, some.passes
        parts.append(points)
    topic = "/octomap_point_cloud_centers"
    check_data(topic, sum(points.nbytes for points in parts))
    cloud = np.concatenate(parts) if parts else np.empty(0, kind)
    fields = [
        messages.make("sensor_msgs/PointField", name, 4 * k, _FLOAT32, 1)
        for k, name in enumerate(names)
    ]
    message = messages.make(
        "sensor_msgs/PointCloud2", messages.header(), 1, len(cloud), fields, False, kind.itemsize,
        kind.itemsize * len(cloud), cloud.view(np.uint8), True,
    )  # fmt: skip
    return TopicMessage(topic, "sensor_msgs/msg/PointCloud2", message)
