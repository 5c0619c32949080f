# SPDX-License-Identifier: Apache-2.0
"""A log seen through something: what it says of itself is what the log behind it says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from oddsmap.scans.log import Log, SensorInfo
from oddsmap.scans.log_items import LogItems
from oddsmap.scans.memory_log import BadLine
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["LogView"]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LogView(LogItems):
    """All scans of another log; satisfies `Log`. Made to be derived from.

    Args:
        log: the log behind it.
    """

    log: Log

    @property
    def path(self) -> str:
        """Where the log was read from."""
        return self.log.path

    @property
    def format(self) -> str:
        """Name of the format, for people."""
        return self.log.format

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The sensors of the log, by id."""
        return self.log.sensors

    @property
    def sensor(self) -> Mapping[str, float]:
        """What the log states about its sensor."""
        return self.log.sensor

    @property
    def skipped(self) -> Counter[str]:
        """Lines and scans of the whole log that could not be read, by reason."""
        return self.log.skipped

    @property
    def notes(self) -> tuple[Note, ...]:
        """What to know about the log."""
        return self.log.notes

    @property
    def bad_lines(self) -> tuple[BadLine, ...]:
        """The first lines that could not be read, where the log knows them."""
        lines: tuple[BadLine, ...] = getattr(self.log, "bad_lines", ())
        return lines

    @property
    def scan_count(self) -> int | None:
        """How many scans there are; None where it is not known of the log behind it."""
        return self.log.scan_count

    def __len__(self) -> int:
        """How many scans there are.

        Raises:
            TypeError: it is not known.
        """
        if self.scan_count is None:
            raise TypeError(f"{self.path}: the number of scans is not known before they are read")
        return self.scan_count

    def __iter__(self) -> Iterator[Scan | Any]:
        """The scans in file order; can be started again."""
        return iter(self.log)
