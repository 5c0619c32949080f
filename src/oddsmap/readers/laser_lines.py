# SPDX-License-Identifier: Apache-2.0
"""What CARMEN logs and g2o graphs make of their laser lines: scans, and the end of their range."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oddsmap.poses.pose import Pose2
from oddsmap.readers.carmen_messages import LaserLine, beam_directions
from oddsmap.readers.no_return_codes import describe_codes, find_codes, find_doubtful_code
from oddsmap.scans.memory_log import BadLine
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["MAX_BAD_LINES_KEPT", "find_range_max", "note_bad_lines", "quote", "to_scan"]

MAX_BAD_LINES_KEPT = 5


def to_scan(line: LaserLine, map_from_sensor: Pose2 | None = None) -> Scan:
    """The scan of a line, from the pose that it states or from another."""
    directions = beam_directions(line.start, line.step, len(line.ranges))
    return Scan(
        map_from_sensor or line.map_from_sensor,
        directions,
        line.ranges,
        line.stamp_ns,
        trusted=True,
    )


def find_range_max(lines: Sequence[LaserLine], notes: list[Note]) -> float | None:
    """The range from which on a finite reading is no return [m]; says in `notes` why."""
    ranges = np.concatenate([line.ranges for line in lines])
    limits: list[float] = []
    codes = find_codes(ranges)
    if codes:
        limits.append(codes[-1].value)
        larger = int(np.count_nonzero(np.isfinite(ranges) & (ranges > codes[0].value)))
        text = describe_codes(codes, larger)
        # With readings above it, it may be a wall that a robot stood still before.
        notes.append(Note(text, code="no_return.found", severity="warning" if larger else "info"))
    if doubtful := find_doubtful_code(ranges, codes):
        value = f"{doubtful.value:g}"
        text = f"{value} m occurs {doubtful.count} times near the top of the range, as no reading "
        text += f"around it does: if it means 'no return', say so with --range-max {value}"
        notes.append(Note(text, code="no_return.doubtful", severity="warning"))
    stated = {line.maximum_range for line in lines if line.maximum_range is not None}
    if stated:
        lowest = min(stated)
        limits.append(lowest)
        count = int(np.count_nonzero(np.isfinite(ranges) & (ranges >= lowest)))
        smallest = " (the smallest it states)" if len(stated) > 1 else ""
        notes.append(
            Note(
                f"the log states a maximum range of {lowest:g} m{smallest}: "
                f"{count} readings at or above it",
                code="range_max.stated",
            )
        )
    return min(limits, default=None)


def note_bad_lines(
    path: str,
    bad_lines: Sequence[BadLine],
    count: int,
    notes: list[Note],
    what: str = "laser lines",
) -> None:
    """Say how many lines were skipped, and what is wrong with the first."""
    if bad_lines:
        text = f"{count} {what} were skipped, the first: {quote(path, bad_lines[0])}"
        notes.append(Note(text, code="log.bad_lines", severity="warning"))


def quote(path: str, bad: BadLine) -> str:
    """A bad line for a message."""
    return f"{path}:{bad.number}: {bad.message}"
