# SPDX-License-Identifier: Apache-2.0
"""CARMEN logs: text, one message per line (`carmen_messages.py` reads one of them).

What is particular about these logs:
- Time stamps are damaged in many of them (cut to 6 digits, all zero, wrapped): the order of the
  scans is the order of the file, always.
- "No return" is a number that differs from log to log, found by `no_return_codes.py`. Where lines
  state a maximum range (ROBOTLASER), the smaller of the two counts. `PARAM robot_front_laser_max`
  is not used: it is a setting of CARMEN's navigation, and logs that say 80.99 m there
  (freiburg-079, belgioioso) hold 81.91 m as their number.
- `#` starts a comment, which may contain the word FLASER. ODOM, NEFF, SYNC and the like hold no
  readings and are ignored; RAWLASER holds readings without a pose, which a note says.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

from oddsmap.errors import InputError
from oddsmap.readers.carmen_messages import (
    HALF_CIRCLE,
    LASER_KINDS,
    BadLineError,
    LaserLine,
    parse_flaser_text,
    parse_laser_line,
)
from oddsmap.readers.compression import Source
from oddsmap.readers.laser_lines import (
    MAX_BAD_LINES_KEPT,
    find_range_max,
    note_bad_lines,
    quote,
    to_scan,
)
from oddsmap.scans.memory_log import BadLine, LoadedLog
from oddsmap.scans.note import Note

__all__ = ["matches", "open_carmen"]

# A line that starts with one of these, or a comment with one of those, makes a file a CARMEN log.
_OTHER_KINDS = (
    *("PARAM", "SYNC", "ODOM", "TRUEPOS", "NEFF", "LASER3", "LASER4", "NMEA-GGA", "NMEAGGA"),
    *("RAWLASER1", "RAWLASER2", "RAWLASER3", "RAWLASER4"),
)
_KNOWN_KINDS = frozenset(kind.encode() for kind in (*LASER_KINDS, *_OTHER_KINDS))
_KNOWN_COMMENTS = (b"# CARMEN Logfile", b"# message formats defined")

# Readings of these have no pose of their own.
_POSELESS_KINDS = tuple(kind for kind in _OTHER_KINDS if "LASER" in kind)

# Half-circle lasers of known beam counts; for others the half circle is worth a note.
_USUAL_BEAM_COUNTS = frozenset({180, 181, 360, 361})


def matches(head: bytes) -> bool:
    """Whether a file that starts like this is a CARMEN log."""
    return any(
        line.startswith(_KNOWN_COMMENTS) or line.split(None, 1)[0] in _KNOWN_KINDS
        for line in head.splitlines()
        if line and not line.isspace()
    )


def open_carmen(source: Source) -> LoadedLog:
    """Read a CARMEN log.

    Args:
        source: the decompressed content.

    Returns:
        The scans of all FLASER, RLASER, ROBOTLASER1 and ROBOTLASER2 lines in file order.
        `sensor["range_max"]` is the lowest number that means "no return" or the maximum range
        that the lines state, whichever is smaller; absent where neither is known.

    Raises:
        InputError: no laser lines, or none that can be used.
    """
    lines: list[LaserLine] = []
    bad_lines: list[BadLine] = []
    kinds: Counter[str] = Counter()
    skipped = source.initial_skipped()
    bad_count = 0
    for number, text in enumerate(source.content.splitlines(), start=1):
        words = text.split(None, 1)
        if not words or words[0].startswith(b"#"):
            continue
        kind = words[0][:24].decode("ascii", "replace")
        kinds[kind] += 1
        if kind not in LASER_KINDS:
            continue
        line = parse_flaser_text(text) if kind in HALF_CIRCLE else None
        if line is not None:
            lines.append(line)
            continue
        try:
            lines.append(parse_laser_line(kind, text.split()))
        except BadLineError as error:
            skipped[error.reason] += 1
            bad_count += 1
            if len(bad_lines) < MAX_BAD_LINES_KEPT:
                bad_lines.append(BadLine(number, str(error)))
    if not lines:
        raise _no_scan_error(source.path, kinds, skipped, bad_lines)

    notes = source.initial_notes()
    note_bad_lines(source.path, bad_lines, bad_count, notes)
    range_max = find_range_max(lines, notes)
    _note_assumptions(lines, kinds, notes)
    return LoadedLog(
        path=source.path,
        format="CARMEN",
        sensor={} if range_max is None else {"range_max": range_max},
        skipped=skipped,
        notes=tuple(notes),
        scans=tuple(to_scan(line) for line in lines),
        bad_lines=tuple(bad_lines),
    )


def _note_assumptions(lines: list[LaserLine], kinds: Counter[str], notes: list[Note]) -> None:
    """Note what to know before trusting a map of these scans."""
    stamps = [line.stamp_ns for line in lines if line.stamp_ns is not None]
    stuck = sum(later <= earlier for earlier, later in pairwise(stamps))
    if stuck:
        notes.append(
            Note(
                f"{stuck} of {len(lines)} time stamps are not later than the one before: "
                "scans are kept in the order of the file",
                code="stamp.order",
                severity="warning",
            )
        )
    if len(stamps) < len(lines):
        notes.append(
            Note(
                f"{len(lines) - len(stamps)} scans have no usable time stamp", code="stamp.missing"
            )
        )
    half_circle = {len(line.ranges) for line in lines if line.kind in HALF_CIRCLE}
    if unusual := half_circle - _USUAL_BEAM_COUNTS:
        counts = ", ".join(str(count) for count in sorted(unusual))
        notes.append(
            Note(
                f"FLASER with {counts} beams: a field of view of 180 degrees is assumed",
                code="field_of_view.assumed",
                severity="warning",
            )
        )
    if poseless := sum(kinds[kind] for kind in _POSELESS_KINDS):
        notes.append(
            Note(
                f"{poseless} RAWLASER and LASER lines have no pose and were not read",
                code="pose.missing",
                severity="warning",
            )
        )
    if kinds["FLASER"] and kinds["ROBOTLASER1"]:
        notes.append(
            Note(
                "FLASER and ROBOTLASER1 lines are both used: if they repeat the same readings, "
                "take one kind out",
                code="log.twice",
                severity="warning",
            )
        )


def _no_scan_error(
    path: str, kinds: Counter[str], skipped: Counter[str], bad_lines: list[BadLine]
) -> InputError:
    if not bad_lines:
        found = ", ".join(f"{kind} ({count})" for kind, count in kinds.most_common(6))
        return InputError(
            f"{path}: no laser lines with poses ({', '.join(LASER_KINDS)}); "
            f"found {found or 'only comments'}: give the log that the laser was recorded in"
        )
    laser_count = sum(kinds[kind] for kind in LASER_KINDS)
    reasons = ", ".join(f"{reason} {count}" for reason, count in skipped.most_common())
    return InputError(
        f"{path}: no usable scan, {laser_count} laser lines were skipped ({reasons}), the first: "
        f"{quote(path, bad_lines[0])}: check that the log was copied and converted whole"
    )
