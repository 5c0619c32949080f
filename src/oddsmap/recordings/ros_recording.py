# SPDX-License-Identifier: Apache-2.0
"""Recordings of ROS: bags of ROS 1, and SQLite and MCAP files of ROS 2. Nothing of ROS is needed.

Source: the package rosbags, https://ternaris.gitlab.io/rosbags/
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from oddsmap.errors import InputError
from oddsmap.recordings.livox_bytes import LIVOX_TYPES, livox_message
from oddsmap.recordings.recording import Message, Topic

__all__ = ["RosRecording", "is_ros_recording", "open_ros_recording"]

_MAGIC = {
    b"#ROSBAG V2.0": "ROS 1 bag",
    b"SQLite format 3": "ROS 2 SQLite file",
    b"\x89MCAP0": "MCAP",
}


def is_ros_recording(head: bytes) -> bool:
    """Whether a file that starts like this may be a recording."""
    return any(head.startswith(magic) for magic in _MAGIC)


@dataclass(frozen=True, slots=True, eq=False)
class RosRecording:
    """A recording that rosbags reads; satisfies `Recording`."""

    path: str
    format: str
    topics: Mapping[str, Topic]
    span_ns: tuple[int, int] | None

    def messages(self, topics: Iterable[str]) -> Iterator[Message]:
        """The messages of some topics, in the order in which they were written."""
        wanted = set(topics)
        with _Reader(self.path) as reader:
            chosen = [each for each in reader.connections if each.topic in wanted]
            if not chosen:
                return
            found = reader.messages(chosen)
            while True:
                # Whatever a damaged file makes of the reader, but not what is done with a message.
                try:
                    connection, log_ns, raw = next(found)
                    if connection.msgtype.replace("/msg/", "/") in LIVOX_TYPES:
                        data: Any = livox_message(raw, cdr=reader.is2)
                    else:
                        data = reader.deserialize(raw, connection.msgtype)
                except StopIteration:
                    return
                except Exception as error:
                    raise _damaged(self.path, error) from None
                yield Message(connection.topic, log_ns, data)


def open_ros_recording(path: str) -> RosRecording:
    """Open a recording: a bag, a `.db3`, an `.mcap`, or a folder of ROS 2.

    Raises:
        InputError: it cannot be read, or rosbags is not installed.
    """
    with _Reader(path) as reader:
        topics: dict[str, Topic] = {}
        for connection in reader.connections:
            before = topics.get(connection.topic)
            count = int(connection.msgcount) + (0 if before is None else before.count or 0)
            # sensor_msgs/msg/LaserScan, as rosbags calls it, by the name that both ROS have.
            kind = connection.msgtype.replace("/msg/", "/")
            topics[connection.topic] = Topic(connection.topic, kind, count)
        span = (int(reader.start_time), int(reader.end_time)) if reader.message_count else None
    return RosRecording(path, _format(path), dict(sorted(topics.items())), span)


def _format(path: str) -> str:
    if Path(path).is_dir():
        return "ROS 2 recording"
    with Path(path).open("rb") as file:
        head = file.read(16)
    return next(name for magic, name in _MAGIC.items() if head.startswith(magic))


class _Reader:
    """The reader of rosbags, open within a `with`, with its errors in our words."""

    def __init__(self, path: str) -> None:
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise InputError(
                f'{path}: recordings are read with rosbags: pip install "oddsmap[ros]"'
            ) from None
        self._path = path
        try:
            # What a file does not describe itself (old SQLite files do not) is as in ROS 2 Jazzy.
            store = get_typestore(Stores.ROS2_JAZZY)
            self._reader = AnyReader([Path(path)], default_typestore=store)
        except Exception as error:
            raise _damaged(path, error) from None

    def __enter__(self) -> Any:
        try:
            self._reader.open()
        except Exception as error:
            raise _damaged(self._path, error) from None
        return self._reader

    def __exit__(self, *_: object) -> None:
        self._reader.close()


def _damaged(path: str, error: Exception) -> InputError:
    return InputError(f"{path}: the recording cannot be read ({error}): copy it again")
