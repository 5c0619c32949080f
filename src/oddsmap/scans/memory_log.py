# SPDX-License-Identifier: Apache-2.0
"""A log that is held in memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from oddsmap.scans.log import SensorInfo
from oddsmap.scans.log_items import LogItems
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["BadLine", "LoadedLog"]


@dataclass(frozen=True, slots=True)
class BadLine:
    """A line that could not be read: its `number`, counted from 1, and what is wrong with it."""

    number: int
    message: str


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LoadedLog(LogItems):
    """All scans of a log, in file order; satisfies the `Log` protocol.

    Args:
        path: where the log was read from, as the caller wrote it.
        format: name of the format, for people.
        sensor: what the log states about its sensor, by the names of the configuration.
        skipped: lines and scans that could not be read, by reason.
        notes: what to know about this log, one sentence each.
        scans: the scans in file order; each learns what the log states, and knows it without it.
        bad_lines: the first few lines that were skipped, for messages.
    """

    path: str
    format: str
    sensor: Mapping[str, float]
    skipped: Counter[str]
    notes: tuple[Note, ...]
    scans: tuple[Scan, ...]
    bad_lines: tuple[BadLine, ...] = ()

    def __post_init__(self) -> None:
        for number, scan in enumerate(self.scans):
            object.__setattr__(scan, "stated", self.sensor)
            object.__setattr__(scan, "number", number)

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The one sensor, as far as the log describes it."""
        return {"": SensorInfo(self.sensor)}

    @property
    def scan_count(self) -> int:
        """How many scans there are."""
        return len(self.scans)

    def __len__(self) -> int:
        """How many scans there are."""
        return len(self.scans)

    def __iter__(self) -> Iterator[Scan]:
        """The scans in file order; can be started again."""
        return iter(self.scans)
