# SPDX-License-Identifier: Apache-2.0
"""Logs of many files, or of one large file: a scan is read on demand and not kept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from oddsmap.errors import InputError
from oddsmap.poses.trajectory import NoPoseError
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.found import Found
from oddsmap.scans.log import SensorInfo
from oddsmap.scans.log_items import LogItems, ReadOnDemand
from oddsmap.scans.note import Note, bad_scans
from oddsmap.scans.scan import Scan

__all__ = ["DepthLog", "LazyLog"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class LazyLog(ReadOnDemand):
    """Scans that are read while one iterates; satisfies the `Log` protocol.

    Args:
        path: where the log was read from, as the caller wrote it.
        format: name of the format, for people.
        scan_count: how many scans there are, the unreadable ones among them.
        read_scan: reads the scan of a number; raises InputError where it cannot be read.
        skip_bad: skip such a scan and count it (`scan.unreadable`, or `scan.no_pose` where there
            is no pose near its stamp), instead of raising.
        opening_notes: what to know before anything is read.
        opening_skipped: what had to be skipped to open the log, by reason.
        sensor: what the log states about its sensor.
        found_notes: what reading scans has shown so far.
        found_skipped: beams that were left out of scans so far, by reason.
        found: where the last two are kept, and which scans could not be read.
    """

    path: str
    format: str
    scan_count: int
    read_scan: Callable[[int], Scan | DepthScan]
    skip_bad: bool = False
    opening_notes: tuple[Note, ...] = ()
    opening_skipped: Counter[str] = field(default_factory=Counter)
    sensor: Mapping[str, float] = field(default_factory=dict)
    found_notes: Callable[[], tuple[Note, ...]] = tuple
    found_skipped: Callable[[], Counter[str]] = Counter
    found: Found = field(default_factory=Found)

    @property
    def skipped(self) -> Counter[str]:
        """What could not be read, by reason, as far as the log has been read."""
        reasons = (
            "scan.no_pose" if isinstance(error, NoPoseError) else "scan.unreadable"
            for error in self.found.bad.values()
        )
        return self.opening_skipped + Counter(reasons) + self.found_skipped()

    @property
    def notes(self) -> tuple[Note, ...]:
        """What to know about this log, one sentence each."""
        notes = (*self.opening_notes, *self.found_notes())
        if not self.found.bad:
            return notes
        first = self.found.bad[min(self.found.bad)]
        return (*notes, bad_scans(len(self.found.bad), first))

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The one sensor, as far as the log describes it."""
        return {"": SensorInfo(self.sensor)}

    def __len__(self) -> int:
        """How many scans there are, the unreadable ones among them."""
        return self.scan_count

    def __iter__(self) -> Iterator[Any]:
        """The measurements in order; can be started again."""
        return self.between(0, self.scan_count)

    def between(self, first: int, past: int) -> Iterator[Any]:
        """The measurements of some numbers, without reading any other.

        Args:
            first: the first number, 0 or above.
            past: the number after the last one.
        """
        for i in range(first, min(past, self.scan_count)):
            try:
                scan = self._read(i)
            except InputError as error:
                if not self.skip_bad:
                    raise
                self.found.bad[i] = error
                continue
            yield scan

    def __getitem__(self, number: Any) -> Any:
        """As of every log; reads the scan alone where none before it can be left out."""
        if isinstance(number, slice) or self.skip_bad:
            return LogItems.__getitem__(self, number)  # super() fails in classes with slots
        try:
            i = range(self.scan_count)[number]
        except IndexError:
            raise IndexError(f"{self.path}: of {self.scan_count} scans none is {number}") from None
        return self._read(i)

    def _read(self, i: int) -> Any:
        scan = self.read_scan(i)
        object.__setattr__(scan, "stated", self.sensor)
        object.__setattr__(scan, "number", i)
        return scan


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class DepthLog(LazyLog):
    """Depth images: it yields `DepthScan`s.

    Args:
        camera: the intrinsics of all images.
    """

    camera: PinholeCamera
