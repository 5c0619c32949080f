# SPDX-License-Identifier: Apache-2.0
"""Small recordings, written by rosbags in each of its containers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

__all__ = ["CONTAINERS", "Messages", "Said"]

CONTAINERS = ("bag", "sqlite3", "mcap")
Said = tuple[str, int, Any]
"""A topic, when it was written [ns], and a message."""


class Messages:
    """Messages of one ROS, and the container that they are written to."""

    def __init__(self, container: str) -> None:
        self.first = container == "bag"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.first else Stores.ROS2_JAZZY)
        self.container = container
        if self.first:  # whose store lacks it
            words = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(words, "tf2_msgs/msg/TFMessage"))

    def make(self, kind: str, *values: Any) -> Any:
        package, name = kind.split("/")
        return self.store.types[f"{package}/msg/{name}"](*values)

    def header(self, stamp_ns: int, frame: str) -> Any:
        stamp = self.make("builtin_interfaces/Time", *divmod(stamp_ns, 10**9))
        return self.make("std_msgs/Header", *((0,) if self.first else ()), stamp, frame)

    def turn(self, yaw: float) -> Any:
        values = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        return self.make("geometry_msgs/Quaternion", *values)

    def transform(
        self, stamp_ns: int, parent: str, child: str, at: Iterable[float], yaw: float
    ) -> Any:
        move = self.make("geometry_msgs/Vector3", *at)
        transform = self.make("geometry_msgs/Transform", move, self.turn(yaw))
        header = self.header(stamp_ns, parent)
        return self.make("geometry_msgs/TransformStamped", header, child, transform)

    def tf(self, *transforms: Any) -> Any:
        return self.make("tf2_msgs/TFMessage", list(transforms))

    def odometry(
        self, stamp_ns: int, frame: str, body: str, at: Iterable[float], yaw: float
    ) -> Any:
        point = self.make("geometry_msgs/Point", *at)
        pose = self.make("geometry_msgs/Pose", point, self.turn(yaw))
        zero = self.make("geometry_msgs/Vector3", 0.0, 0.0, 0.0)
        twist = self.make("geometry_msgs/Twist", zero, zero)
        return self.make(
            "nav_msgs/Odometry",
            self.header(stamp_ns, frame),
            body,
            self.make("geometry_msgs/PoseWithCovariance", pose, np.zeros(36)),
            self.make("geometry_msgs/TwistWithCovariance", twist, np.zeros(36)),
        )

    def laser(
        self,
        stamp_ns: int,
        frame: str,
        ranges: npt.ArrayLike,
        start: float = 0.0,
        step: float = 0.1,
        every: float = 0.0,
    ) -> Any:
        readings = np.asarray(ranges, np.float32)
        angles = (start, start + step * len(readings), step)
        header, nothing = self.header(stamp_ns, frame), np.zeros(0, np.float32)
        values = (header, *angles, every, 0.0, 0.1, 30.0, readings, nothing)
        return self.make("sensor_msgs/LaserScan", *values)

    def cloud(
        self, stamp_ns: int, frame: str, table: npt.NDArray[np.void], *, rows: int = 1
    ) -> Any:
        """A cloud with the fields of a structured array."""
        numbers = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
        fields = []
        for name in table.dtype.names or ():
            assert table.dtype.fields is not None
            kind, offset = table.dtype.fields[name][:2]
            number = numbers[kind.str.lstrip("<>|")]
            fields.append(self.make("sensor_msgs/PointField", name, offset, number, 1))
        size = table.dtype.itemsize
        content = np.frombuffer(table.tobytes(), np.uint8)
        width = len(table) // rows
        header = self.header(stamp_ns, frame)
        shape = (False, size, width * size, content, True)
        return self.make("sensor_msgs/PointCloud2", header, rows, width, fields, *shape)

    def range(
        self,
        stamp_ns: int,
        frame: str,
        reading: float,
        *,
        angle: float = 0.5,
        limits: tuple[float, float] = (0.1, 4.0),
    ) -> Any:
        """A reading of a sonar."""
        header = self.header(stamp_ns, frame)
        variance = () if self.first else (0.0,)
        return self.make("sensor_msgs/Range", header, 0, angle, *limits, reading, *variance)

    def image(
        self,
        stamp_ns: int,
        frame: str,
        pixels: npt.NDArray[Any],
        encoding: str,
        *,
        padding: int = 0,
    ) -> Any:
        """An image, each of its rows followed by some bytes."""
        height, width = pixels.shape[:2]
        rows = pixels.reshape(height, -1).view(np.uint8)
        rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
        big = int(pixels.dtype.str.startswith(">"))
        values = (height, width, encoding, big, rows.shape[1], rows.reshape(-1))
        return self.make("sensor_msgs/Image", self.header(stamp_ns, frame), *values)

    def camera(
        self,
        stamp_ns: int,
        frame: str,
        size: tuple[int, int],
        k: tuple[float, float, float, float],
        *,
        p: tuple[float, float, float, float] | None = None,
        distortion: Iterable[float] = (),
    ) -> Any:
        """Intrinsics: width and height, then fx, fy, cx and cy of K and of P."""
        fx, fy, cx, cy = k
        of_k = np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0])
        fx, fy, cx, cy = p or k
        of_p = np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1.0, 0])
        d = np.array(list(distortion), np.float64)
        roi = self.make("sensor_msgs/RegionOfInterest", 0, 0, 0, 0, False)
        values = (size[1], size[0], "plumb_bob", d, of_k, np.eye(3).ravel(), of_p, 0, 0, roi)
        return self.make("sensor_msgs/CameraInfo", self.header(stamp_ns, frame), *values)

    def livox(
        self, stamp_ns: int, frame: str, points: npt.NDArray[np.float64], offsets: Iterable[int]
    ) -> Any:
        """Points of Livox's driver, with times after the stamp [ns]."""
        package = "livox_ros_driver" if self.first else "livox_ros_driver2"
        kind = f"{package}/msg/CustomMsg"
        if kind not in self.store.types:
            words = "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\n"
            point = get_types_from_msg(
                f"{words}uint8 tag\nuint8 line", f"{package}/msg/CustomPoint"
            )
            words = "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\n"
            words += "uint8[3] rsvd\nCustomPoint[] points"
            self.store.register(point | get_types_from_msg(words, kind))
        rows = [
            self.make(f"{package}/CustomPoint", int(late), *map(float, point), 10, 0, 0)
            for point, late in zip(points, offsets, strict=True)
        ]
        rest = (stamp_ns, len(rows), 0, np.zeros(3, np.uint8), rows)
        return self.make(f"{package}/CustomMsg", self.header(stamp_ns, frame), *rest)

    def write(
        self, path: Path, said: Iterable[Said], *, chunk_bytes: int = 1 << 20, spoilt: int = -1
    ) -> Path:
        """A recording of messages, in the order given.

        Args:
            path: without its suffix.
            said: the messages.
            chunk_bytes: of a bag of ROS 1: when a new chunk begins.
            spoilt: the number of a message that ends too early.
        """
        if self.first:
            path = path.with_suffix(".bag")
            writer: Any = Writer1(path)
            writer.chunk_threshold = chunk_bytes
            serialize = self.store.serialize_ros1
        else:
            plugin = StoragePlugin[self.container.upper()]
            writer = Writer2(path, version=9, storage_plugin=plugin)
            serialize = self.store.serialize_cdr
        with writer:
            topics: dict[str, Any] = {}
            for number, (topic, log_ns, message) in enumerate(said):
                kind = message.__msgtype__
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, kind, typestore=self.store)
                data = serialize(message, kind)
                writer.write(topics[topic], log_ns, data[:30] if number == spoilt else data)
        return path
