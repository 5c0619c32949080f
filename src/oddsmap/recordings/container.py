# SPDX-License-Identifier: Apache-2.0
"""What a container of messages is: a file of bytes on channels, which says what they mean."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from oddsmap.recordings.recording import Damage

__all__ = [
    "FIRST_PLACE", "Channel", "ChunkError", "Container", "PlacedMessage", "RawMessage", "megabytes",
]  # fmt: skip

RawMessage = tuple[int, int, "bytes | memoryview"]
"""The number of a channel, when it was written [ns], and the message as it stands in the file."""
PlacedMessage = tuple[int, int, "bytes | memoryview", int]
"""The same, and its place in the file; places never fall, and several messages may share one."""
FIRST_PLACE = -(1 << 63)


@dataclass(frozen=True, slots=True)
class Channel:
    """Where messages of one kind come from.

    Args:
        topic: its name.
        type: of the messages, as the file names it.
        encoding: how a message is written: "ros1", "cdr", "json", "protobuf" ...
        schema_encoding: how `schema` is written: "ros1msg", "ros2msg", "ros2idl", "jsonschema",
            "protobuf" ...; empty where there is none.
        schema: what a message is made of.
        digest: a hash of that, which both ROS have; empty where the file has none.
    """

    topic: str
    type: str
    encoding: str
    schema_encoding: str
    schema: bytes
    digest: str = ""


class Container(Protocol):
    """One file of messages."""

    @property
    def path(self) -> str:
        """Where it is."""

    @property
    def format(self) -> str:
        """Name of the format, for people."""

    @property
    def channels(self) -> Mapping[int, Channel]:
        """Its channels by number."""

    @property
    def counts(self) -> Mapping[int, int]:
        """How many messages each channel has."""

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """When its first and last message were written [ns]; None where there is none."""

    @property
    def damage(self) -> Sequence[Damage]:
        """What is missing, as far as the file has been read."""

    @property
    def has_places(self) -> bool:
        """Whether reading from a place gives what reading all of the file gives from there on."""

    def raw(self, wanted: Collection[int], start: int = FIRST_PLACE) -> Iterator[PlacedMessage]:
        """The messages of some channels, in the order in which they were written.

        Args:
            wanted: numbers of channels.
            start: the place to begin at; what comes before is not read.

        Raises:
            InputError: the file is damaged, and damage was not to be skipped.
        """


class ChunkError(Exception):
    """A part of a container that cannot be read."""


def megabytes(count: int) -> str:
    """A number of bytes for messages, in kB where it is small."""
    if count < 1_000_000:
        return f"{count / 1e3:.3g} kB"
    return f"{count / 1e6:.{2 if count < 10**8 else 0}f} MB"
