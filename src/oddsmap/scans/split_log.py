# SPDX-License-Identifier: Apache-2.0
"""Every k-th scan kept back from a map, to score it with."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from oddsmap.errors import ConfigError
from oddsmap.scans.log import Log
from oddsmap.scans.log_view import LogView
from oddsmap.scans.scan import Scan

__all__ = ["PartOfLog", "every_of", "hold_out"]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PartOfLog(LogView):
    """The scans of a log that are mapped, or those that are held out; satisfies `Log`.

    Args:
        log: the whole log.
        every: the k-th, 2k-th, 3k-th scan of each sensor that can be read is held out.
        held: True: these scans; False: all others.
    """

    every: int
    held: bool

    @property
    def scan_count(self) -> int | None:
        """How many scans there are; None where it is not known of the whole log."""
        whole = self.log.scan_count
        if whole is None:
            return None
        held = whole // self.every
        return held if self.held else whole - held

    def __iter__(self) -> Iterator[Scan | Any]:
        """The scans in file order; can be started again."""
        # Each sensor is counted by itself: the same scans are held out of all and of one alone.
        numbers: Counter[str] = Counter()
        for scan in self.log:
            numbers[scan.sensor_id] += 1
            if (numbers[scan.sensor_id] % self.every == 0) == self.held:
                yield scan


def hold_out(log: Log, every: int) -> tuple[PartOfLog, PartOfLog]:
    """Split a log into the scans to map and every k-th scan, held out; the same ones each time.

    Args:
        log: the whole log.
        every: k, at least 2: the k-th, 2k-th, 3k-th scan is held out.

    Returns:
        The scans to map, and the scans held out.

    Raises:
        ConfigError: k is below 2.
    """
    if every < 2:
        raise ConfigError(f"every k-th scan is held out, k at least 2, got {every}")
    return PartOfLog(log, every, held=False), PartOfLog(log, every, held=True)


def every_of(share: float) -> int:
    """Which scan is held out for a share of them: 0.1 is every tenth.

    Raises:
        ConfigError: the share is not above 0 and up to one half.
    """
    if not 0.0 < share <= 0.5:
        raise ConfigError(
            f"--hold-out {share:g}: the share of scans kept back lies above 0 and up to 0.5"
        )
    return round(1.0 / share)
