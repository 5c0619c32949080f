# SPDX-License-Identifier: Apache-2.0
"""Every k-th scan, or run of scans, kept back from a map, to score it with."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from oddsmap.errors import ConfigError
from oddsmap.scans.log import Log
from oddsmap.scans.log_view import LogView
from oddsmap.scans.scan import Scan

__all__ = ["PartOfLog", "every_of", "held_count", "hold_out", "is_held", "run_of"]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PartOfLog(LogView):
    """The scans of a log that are mapped, or those that are held out; satisfies `Log`.

    Args:
        log: the whole log.
        every: the k-th, 2k-th, 3k-th run of scans of each sensor that can be read is held out.
        held: True: these scans; False: all others.
        run: scans in a run, counted from the first.
    """

    every: int
    held: bool
    run: int = 1

    @property
    def scan_count(self) -> int | None:
        """How many scans there are; None where it is not known of the whole log."""
        whole = self.log.scan_count
        if whole is None:
            return None
        held = held_count(whole, self.every, self.run)
        return held if self.held else whole - held

    def __iter__(self) -> Iterator[Scan | Any]:
        """The scans in file order; can be started again."""
        # Each sensor is counted by itself: the same scans are held out of all and of one alone.
        numbers: Counter[str] = Counter()
        for scan in self.log:
            numbers[scan.sensor_id] += 1
            if is_held(numbers[scan.sensor_id], self.every, self.run) == self.held:
                yield scan


def hold_out(log: Log, every: int, run: int = 1) -> tuple[PartOfLog, PartOfLog]:
    """Split a log into the scans to map and those held out; the same ones each time.

    Args:
        log: the whole log.
        every: k, at least 2: the k-th, 2k-th, 3k-th run of scans is held out.
        run: how many scans are a run.

    Returns:
        The scans to map, and the scans held out.

    Raises:
        ConfigError: k is below 2, or a run below 1.
    """
    if every < 2:
        raise ConfigError(f"every k-th scan is held out, k at least 2, got {every}")
    if run < 1:
        raise ConfigError(f"a run has 1 scan or more, got {run}")
    return PartOfLog(log, every, False, run), PartOfLog(log, every, True, run)


def is_held(number: int, every: int, run: int = 1) -> bool:
    """Whether a scan is held out: its number counted from 1, the others as in `hold_out`."""
    return -(-number // run) % every == 0


def held_count(scans: int, every: int, run: int = 1) -> int:
    """How many of some scans are held out: arguments as in `hold_out`."""
    cycles, rest = divmod(scans, every * run)
    return cycles * run + max(0, rest - (every - 1) * run)


def run_of(log: Log) -> int:
    """Scans in a hundredth of a log, and two at least: of a place it is back a while later.

    A log that does not know its number of scans is read through.
    """
    scans = log.scan_count
    return max(2, (sum(1 for _ in log) if scans is None else scans) // 100)


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
