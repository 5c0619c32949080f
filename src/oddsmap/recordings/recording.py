# SPDX-License-Identifier: Apache-2.0
"""What a recording is: messages on topics, in the order in which they were written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

from oddsmap.errors import InputError, as_line

__all__ = [
    "START", "TRUNCATED", "Damage", "Message", "Place", "Recording", "Topic", "shape_of",
    "stamp_of",
]  # fmt: skip

# The reason under which messages are counted that a damaged file has lost.
TRUNCATED = "container.truncated"

Place = tuple[int, int]
"""The number of a file of a recording, and the place in it."""
START: Place = (0, -(1 << 63))


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a recording.

    Args:
        name: as it stands in the file.
        type: of its messages, "sensor_msgs/LaserScan", whichever ROS wrote it.
        count: how many messages there are; None where the file does not say.
        problem: why its messages cannot be read; empty where they can.
    """

    name: str
    type: str
    count: int | None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Damage:
    """A part of a recording that is missing or cannot be read.

    Args:
        text: what is wrong, and where.
        messages: how many messages are lost by it; None where that cannot be known.
        seconds: how long they took; None where that cannot be known.
    """

    text: str
    messages: int | None = None
    seconds: float | None = None

    def __str__(self) -> str:
        if self.messages is None:
            return f"{self.text}: how many messages are lost is not known"
        took = "" if self.seconds is None else f" ({self.seconds:.4g} s)"
        return f"{self.text}: {self.messages:,} messages{took} are lost"


@dataclass(frozen=True, slots=True)
class Message:
    """A message.

    Args:
        topic: its name.
        log_ns: when it was written [ns]; what it says of itself is in its header.
        data: the message with its fields as attributes, numbers in arrays.
        place: where it is in the recording; places never fall, and several messages may share one.
    """

    topic: str
    log_ns: int
    data: Any
    place: Place = START


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

    @property
    def damage(self) -> Sequence[Damage]:
        """What is missing, as far as the file has been read; empty where nothing is."""

    @property
    def has_places(self) -> bool:
        """Whether reading from a place gives what reading all of it gives from there on."""

    def messages(self, topics: Iterable[str], start: Place = START) -> Iterator[Message]:
        """The messages of some topics, in the order in which they were written.

        Args:
            topics: their names.
            start: the place to begin at; what comes before is not read.

        Raises:
            InputError: the file is damaged.
        """


@contextmanager
def shape_of(kind: str) -> Iterator[None]:
    """Say in one line where a message has not the fields and values that its type should have.

    A file says itself what its messages are made of, and JSON may have anything anywhere.

    Raises:
        InputError: in place of what Python raises where a field is missing or no number.
    """
    try:
        yield
    except InputError:
        raise
    except (
        ArithmeticError, AttributeError, IndexError, KeyError, TypeError, ValueError
    ) as error:  # fmt: skip
        raise InputError(f"a message that is no {kind} ({as_line(str(error), 100)})") from None


def stamp_of(header: Any) -> int:
    """The stamp of a header [ns]."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)
