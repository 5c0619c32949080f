# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS 1 and ROS 2, made by rosbags, and the header that all of a map's have.

Source: the definitions of std_msgs, nav_msgs, sensor_msgs, octomap_msgs and foxglove_msgs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from oddsmap.errors import ConfigError, InputError

__all__ = ["MapHeader", "MapMessages", "RosMessages", "TopicMessage", "check_data", "check_header"]

# What rosbags does not bring along.
_OCTOMAP = "std_msgs/Header header\nbool binary\nstring id\nfloat64 resolution\nint8[] data\n"
_VECTOR2 = "float64 x\nfloat64 y\n"
_FIELD = (
    "string name\nuint32 offset\n"
    "uint8 UNKNOWN=0\nuint8 UINT8=1\nuint8 INT8=2\nuint8 UINT16=3\nuint8 INT16=4\n"
    "uint8 UINT32=5\nuint8 INT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\nuint8 type\n"
)
_GRID = (
    "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose\n"
    "uint32 column_count\nfoxglove_msgs/Vector2 cell_size\nuint32 row_stride\n"
    "uint32 cell_stride\nfoxglove_msgs/PackedElementField[] fields\nuint8[] data\n"
)
_VOXELS = (
    "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose\n"
    "uint32 row_count\nuint32 column_count\ngeometry_msgs/Vector3 cell_size\n"
    "uint32 slice_stride\nuint32 row_stride\nuint32 cell_stride\n"
    "foxglove_msgs/PackedElementField[] fields\nuint8[] data\n"
)
_NOT_ALL_HAVE = {
    "octomap_msgs/msg/Octomap": _OCTOMAP,
    "foxglove_msgs/msg/Vector2": _VECTOR2,
    "foxglove_msgs/msg/PackedElementField": _FIELD,
    "foxglove_msgs/msg/Grid": _GRID,
    "foxglove_msgs/msg/VoxelGrid": _VOXELS,
}

_MOST_BYTES = 2**31 - 1  # of one message: what all of ROS's middlewares take

_LATEST_STAMP_S = 2**31 - 1  # seconds are an int32 in ROS 2


@dataclass(frozen=True, slots=True)
class MapHeader:
    """What the messages of a map say of it.

    Args:
        frame: the frame that the map is in.
        stamp_ns: its time [ns]; 0 in ROS stands for the latest transforms.
    """

    frame: str = "map"
    stamp_ns: int = 0


class TopicMessage(NamedTuple):
    """A message and the topic that it goes to."""

    topic: str
    type: str
    message: Any


class MapMessages(Protocol):
    """What makes messages of a map: by ROS's names of their types, whatever they become."""

    @property
    def frame(self) -> str:
        """The frame of the map."""
        ...

    def make(self, kind: str, *values: Any) -> Any:
        """A message of a type such as foxglove_msgs/Grid, its fields in order."""
        ...

    def stamp(self) -> Any:
        """The time of the map."""
        ...


def check_header(header: MapHeader) -> None:
    """Refuse frames and stamps that no message can have.

    Raises:
        ConfigError: no name, one with blanks, or a stamp outside the years 1970 to 2038.
    """
    if not header.frame or any(c.isspace() or not c.isprintable() for c in header.frame):
        raise ConfigError(f"--frame is the name of a frame, such as map, got {header.frame!r}")
    if header.frame.startswith("/"):
        raise ConfigError(
            f"--frame {header.frame}: frames have no leading slash since ROS 2, say "
            f"{header.frame.lstrip('/') or 'map'}"
        )
    if not 0 <= header.stamp_ns <= _LATEST_STAMP_S * 10**9:
        raise ConfigError(
            f"--stamp is a time from 0 to {_LATEST_STAMP_S} s since 1970, which is what messages "
            f"can hold, got {header.stamp_ns / 1e9:.10g}"
        )


def check_data(topic: str, size: int) -> None:
    """Refuse a message that is too long to be sent.

    Raises:
        InputError: it has more than 2^31 bytes.
    """
    if size > _MOST_BYTES:
        raise InputError(
            f"{topic}: {size / 1e9:.3g} GB in one message, which holds {_MOST_BYTES / 1e9:.3g} GB: "
            "make it of a coarser map, or crop it"
        )


class RosMessages:
    """Makes messages of one of the two ROS, and says how they look in a bag.

    Args:
        version: 1 or 2.
        header: what all messages say of the map.

    Raises:
        ConfigError: rosbags is not installed, or the header cannot be written.
    """

    def __init__(self, version: int, header: MapHeader) -> None:
        check_header(header)
        try:
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ImportError:
            raise ConfigError(
                'bags and MCAP are written with rosbags: pip install "oddsmap[ros]"'
            ) from None
        self.version, self._header = version, header
        self.store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
        for name, words in _NOT_ALL_HAVE.items():
            if name not in self.store.fielddefs and not (version == 1 and "foxglove" in name):
                self.store.register(get_types_from_msg(words, name))

    def make(self, kind: str, *values: Any) -> Any:
        """A message of a type such as nav_msgs/OccupancyGrid, its fields in order."""
        package, name = kind.split("/")
        return self.store.types[f"{package}/msg/{name}"](*values)

    def stamp(self) -> Any:
        """The time of the map."""
        return self.make("builtin_interfaces/Time", *divmod(self._header.stamp_ns, 10**9))

    @property
    def frame(self) -> str:
        """The frame of the map."""
        return self._header.frame

    def header(self) -> Any:
        """A std_msgs/Header."""
        number = (0,) if self.version == 1 else ()
        return self.make("std_msgs/Header", *number, self.stamp(), self.frame)

    def serialized(self, message: TopicMessage) -> memoryview:
        """The bytes of a message, as bags of this ROS have them."""
        serialize = self.store.serialize_ros1 if self.version == 1 else self.store.serialize_cdr
        return serialize(message.message, message.type)
