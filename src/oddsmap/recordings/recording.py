# SPDX-License-Identifier: Apache-2.0
"""What a recording is: messages on topics, in the order in which they were written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

__all__ = ["Message", "Recording", "Topic", "stamp_of"]


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a recording.

    Args:
        name: as it stands in the file.
        type: of its messages, "sensor_msgs/LaserScan", whichever ROS wrote it.
        count: how many messages there are; None where the file does not say.
    """

    name: str
    type: str
    count: int | None


@dataclass(frozen=True, slots=True)
class Message:
    """A message.

    Args:
        topic: its name.
        log_ns: when it was written [ns]; what it says of itself is in its header.
        data: the message with its fields as attributes, numbers in arrays.
    """

    topic: str
    log_ns: int
    data: Any


class Recording(Protocol):
    """A file, or a folder of files, of messages."""

    @property
    def path(self) -> str:
        """Where it was read from."""

    @property
    def format(self) -> str:
        """Name of the format, for people: "ROS 1 bag"."""

    @property
    def topics(self) -> Mapping[str, Topic]:
        """Its topics by name."""

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """When its first and last message were written [ns]; None where there is none."""

    def messages(self, topics: Iterable[str]) -> Iterator[Message]:
        """The messages of some topics, in the order in which they were written.

        Raises:
            InputError: the file is damaged.
        """


def stamp_of(header: Any) -> int:
    """The stamp of a header [ns]."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)
