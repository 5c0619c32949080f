# SPDX-License-Identifier: Apache-2.0
"""What a log is: measurements with poses, one after the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, overload

from oddsmap.poses.pose import Pose
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan
from oddsmap.short_repr import short_repr

__all__ = ["Log", "SensorInfo", "parts_of"]


@dataclass(frozen=True, slots=True, eq=False)
class SensorInfo:
    """What a log states about one sensor.

    Args:
        settings: by the names of the configuration: `range_max` [m], `cone_deg` [deg]...
        body_from_sensor: pose of the sensor on the body; None where the log does not state it, or
            where its poses are those of the sensor.
    """

    settings: Mapping[str, float] = field(default_factory=dict)
    body_from_sensor: Pose | None = None

    __repr__ = short_repr


class Log(Protocol):
    """A stream of measurements with their poses, and what had to be skipped to get them.

    A large log reads its measurements on demand and does not keep them. Each measurement has
    the id of the sensor that made it (`sensor_id`), one of the keys of `sensors`.
    """

    @property
    def path(self) -> str:
        """Where the log was read from."""

    @property
    def format(self) -> str:
        """Name of the format, for people: "CARMEN", "NPZ beam log"."""

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """Its sensors by id; a log of one sensor calls it ""."""

    @property
    def sensor(self) -> Mapping[str, float]:
        """What the log states about all its sensors, by the names of the configuration."""

    @property
    def scan_count(self) -> int | None:
        """How many measurements there are; None where that is not known before they are read."""

    @property
    def skipped(self) -> Counter[str]:
        """Lines and scans that could not be read so far, by reason ("line.short": 3)."""

    @property
    def notes(self) -> tuple[Note, ...]:
        """What to know about this log, one sentence each."""

    def __len__(self) -> int:
        """`scan_count`.

        Raises:
            TypeError: it is not known.
        """

    # Scans of ranges nearly always, so that is what type checkers offer; `Any` stands for the
    # `DepthScan`s of a depth camera and the `GridScan`s of a log of grids.
    def __iter__(self) -> Iterator[Scan | Any]:
        """The measurements in file order; can be started again."""

    @overload
    def __getitem__(self, number: int) -> Scan | Any: ...
    @overload
    def __getitem__(self, number: slice) -> list[Scan | Any]: ...
    def __getitem__(self, number: int | slice) -> Any:
        """The measurement of a number, as iterating gives it; of a slice, a list of them."""

    @property
    def poses(self) -> list[Pose]:
        """Of each measurement the pose of its sensor, map_from_sensor; reads the whole log."""


def parts_of(log: Any) -> list[Any]:
    """A log in parts, each of sensors that state the same; most logs are one part.

    Each reading has to be judged by what its own sensor states, and one sensor model takes one
    range_max: whoever makes models of what a log states makes one for each part.
    """
    parts: list[Any] = log.parts() if hasattr(log, "parts") else [log]
    return parts
