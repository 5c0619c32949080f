# SPDX-License-Identifier: Apache-2.0
"""What a log is: measurements with poses, one after the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Protocol

from oddsmap.scans.scan import Scan

__all__ = ["Log"]


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

    # Scans of ranges nearly always, so that is what type checkers offer; `Any` stands for the
    # `GridScan`s of a log of grids.
    def __iter__(self) -> Iterator[Scan | Any]:
        """The scans in file order; can be started again."""
