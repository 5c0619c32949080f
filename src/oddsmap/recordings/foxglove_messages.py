# SPDX-License-Identifier: Apache-2.0
"""Foxglove's messages in the shape of those of ROS, so that nothing else need know them.

They come as JSON, as protobuf or as messages of ROS. A scan or a cloud has a pose of its own in its
frame: `frame_from_sensor` of what is made of it, where that is not the identity.

Source: https://docs.foxglove.dev/docs/sdk/schemas
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Iterator
from datetime import datetime
from types import SimpleNamespace
from typing import Any

import numpy as np

from oddsmap.errors import InputError, shown
from oddsmap.poses.pose import Pose3

__all__ = ["ADAPTERS", "TYPES", "JsonObject"]


class JsonObject(SimpleNamespace):
    """An object of JSON: its values as attributes."""

    def __init__(self, values: dict[str, Any]) -> None:
        super().__init__(**values)
        if "nsec" in values:  # in a stamp, ROS 2 calls it so
            self.nanosec = values["nsec"]


def _laser_scan(data: Any) -> Any:
    ranges = _numbers(data.ranges)
    first, last = float(data.start_angle), float(data.end_angle)
    step = (last - first) / (len(ranges) - 1) if len(ranges) > 1 else 0.0
    return SimpleNamespace(
        header=_header(data),
        angle_min=first,
        angle_max=last,
        angle_increment=step,
        time_increment=0.0,
        scan_time=0.0,
        range_min=math.nan,
        range_max=math.nan,
        ranges=ranges,
        intensities=_numbers(getattr(data, "intensities", ())),
        frame_from_sensor=_own_pose(data),
    )


def _point_cloud(data: Any) -> Any:
    content = data.data
    if isinstance(content, str):
        content = base64.b64decode(content, validate=True)
    values = np.frombuffer(content, np.uint8)
    stride = int(data.point_stride)
    count = len(values) // stride if stride > 0 else 0
    if stride <= 0 or count * stride != len(values):
        raise InputError(f"a cloud of {len(values)} bytes in points of {stride} bytes")
    fields = [
        SimpleNamespace(
            name=str(f.name), offset=int(getattr(f, "offset", 0)), datatype=_kind(f), count=1
        )
        for f in data.fields
    ]
    return SimpleNamespace(
        header=_header(data),
        height=1,
        width=count,
        fields=fields,
        is_bigendian=False,
        point_step=stride,
        row_step=len(values),
        data=values,
        is_dense=False,
        frame_from_sensor=_own_pose(data),
    )


def _frame_transform(data: Any) -> Any:
    return SimpleNamespace(transforms=[_transform(data)])


def _frame_transforms(data: Any) -> Any:
    return SimpleNamespace(transforms=[_transform(each) for each in data.transforms])


def _transform(data: Any) -> Any:
    header = SimpleNamespace(stamp=_stamp(data.timestamp), frame_id=str(data.parent_frame_id))
    return SimpleNamespace(
        header=header,
        child_frame_id=str(data.child_frame_id),
        transform=SimpleNamespace(translation=data.translation, rotation=data.rotation),
    )


def _pose_in_frame(data: Any) -> Any:
    return SimpleNamespace(header=_header(data), pose=data.pose)


# Foxglove's types of numbers, and those that PointField has for them.
_KINDS = {"UINT8": 2, "INT8": 1, "UINT16": 4, "INT16": 3, "UINT32": 6, "INT32": 5}
_KINDS |= {"FLOAT32": 7, "FLOAT64": 8}
_BY_NUMBER = dict(enumerate(_KINDS.values(), start=1))


def _kind(element: Any) -> int:
    """The type of an element of a point, which JSON may have by its name; 0 where it is unknown."""
    kind = getattr(element, "type", 0)
    return _KINDS.get(kind, 0) if isinstance(kind, str) else _BY_NUMBER.get(int(kind), 0)


def _numbers(values: Any) -> Any:
    """Numbers of an array; null, which JSON has for NaN, is that."""
    if isinstance(values, list) and None in values:
        values = [math.nan if value is None else value for value in values]
    return np.array(values, np.float64)


def _header(data: Any) -> Any:
    return SimpleNamespace(stamp=_stamp(data.timestamp), frame_id=str(data.frame_id))


def _stamp(time: Any) -> Any:
    """A time as ROS 2 has it."""
    if isinstance(time, str):  # as protobuf writes it in JSON
        whole, _, rest = time.removesuffix("Z").partition(".")
        seconds = datetime.fromisoformat(f"{whole}+00:00").timestamp()
        return SimpleNamespace(sec=int(seconds), nanosec=int(rest[:9].ljust(9, "0")))
    for first, second in (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos")):
        if hasattr(time, first) and hasattr(time, second):
            return SimpleNamespace(
                sec=int(getattr(time, first)), nanosec=int(getattr(time, second))
            )
    raise InputError(f"a time that is none: {shown(time)}")


def _own_pose(data: Any) -> Pose3 | None:
    """The pose of a scan in its frame; None where it is the identity."""
    pose = getattr(data, "pose", None)
    if pose is None or not (_has(pose, "position") or _has(pose, "orientation")):
        return None
    p, q = pose.position, pose.orientation
    place, turn = (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)
    if not any(place) and not any(turn[:3]):
        return None  # also where all four are 0, as protobuf has them unless they are set
    return Pose3.from_quaternion_xyzw(place, turn)


def _has(data: Any, name: str) -> bool:
    value = getattr(data, name, None)
    return value is not None and all(hasattr(value, axis) for axis in "xyz")


_KINDS_OF_MESSAGES: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "LaserScan": ("sensor_msgs/LaserScan", _laser_scan),
    "PointCloud": ("sensor_msgs/PointCloud2", _point_cloud),
    "FrameTransform": ("tf2_msgs/TFMessage", _frame_transform),
    "FrameTransforms": ("tf2_msgs/TFMessage", _frame_transforms),
    "PoseInFrame": ("geometry_msgs/PoseStamped", _pose_in_frame),
}


def _named() -> Iterator[tuple[str, str, Callable[[Any], Any]]]:
    for name, (kind, adapt) in _KINDS_OF_MESSAGES.items():
        yield f"foxglove.{name}", kind, adapt
        yield f"foxglove_msgs/{name}", kind, adapt


TYPES = {name: kind for name, kind, _ in _named()}
"""The type of ROS whose shape a message gets, by Foxglove's."""

ADAPTERS = {name: adapt for name, _, adapt in _named()}
"""What gives it that shape."""
