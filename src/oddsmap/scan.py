# SPDX-License-Identifier: Apache-2.0
"""A measurement z_t with its pose, and what a log is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.poses import Pose, Pose2

__all__ = ["Log", "Scan"]


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One measurement z_t: ranges along known directions, from a known pose.

    Args:
        map_from_sensor: pose of the sensor in the map frame.
        directions: unit vectors in the sensor frame, shape (n, d), d = 2 or 3. Scans of one
            sensor may share the array: it is never written to.
        ranges: distance along each direction [m], shape (n,). +Inf = nothing seen, NaN or
            -Inf = no information (REP-117).
        stamp_ns: time of the scan [ns], or None where the log has none to trust.

    Raises:
        InputError: the shapes do not fit each other.
    """

    map_from_sensor: Pose
    directions: npt.NDArray[np.float64]
    ranges: npt.NDArray[np.float64]
    stamp_ns: int | None = None

    def __post_init__(self) -> None:
        d = 2 if isinstance(self.map_from_sensor, Pose2) else 3
        n = len(self.ranges)
        if self.ranges.ndim != 1 or self.directions.shape != (n, d):
            raise InputError(
                f"a scan with a {d}D pose needs ranges (n,) and directions (n, {d}), "
                f"got {self.ranges.shape} and {self.directions.shape}"
            )


class Log(Protocol):
    """Scans in file order, and what had to be skipped to get them."""

    @property
    def path(self) -> str:
        """Where the log was read from."""

    @property
    def format(self) -> str:
        """Name of the format, for people: "CARMEN", "NPZ beam log"."""

    @property
    def sensor(self) -> Mapping[str, float]:
        """What the log says of its sensor, by the names of the configuration: `range_max` [m]..."""

    @property
    def skipped(self) -> Counter[str]:
        """Lines and scans that could not be read, by reason ("line.short": 3)."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know of this log, one sentence each."""

    def __len__(self) -> int:
        """How many scans there are."""

    def __iter__(self) -> Iterator[Scan]:
        """The scans in file order; can be started again."""
