# SPDX-License-Identifier: Apache-2.0
"""GPS times of points and stamps of a trajectory: which clock each has.

LAS has seconds of the GPS week, which start again each Sunday, or seconds since 6 January 1980 less
10^9 ("adjusted standard"); its flag that says which is often wrong. Trajectories have either, or
all seconds since 1980. These clocks differ by known amounts, and only one of them lets two spans of
time overlap, as a rule. Unix time differs by leap seconds, too, and by whether a program minded
them: that is left to the caller.

Source: ASPRS, LAS Specification 1.4 - R15, Table 4 and 8.
"""

from __future__ import annotations

from collections.abc import Iterator

from oddsmap.errors import InputError
from oddsmap.poses.trajectory import format_seconds
from oddsmap.scans.note import Note

__all__ = ["Span", "clock_offset_ns", "clock_offset_of_utc_ns"]

Span = tuple[int, int]
"""First and last time [ns]."""

_S = 10**9
_WEEK = 604_800 * _S
_ADJUSTED = 10**9 * _S
# From 1970 to 1980, and the leap seconds since (18 from 2017 on).
_GPS_EPOCH = 315_964_800 * _S
_LEAP = 18 * _S
# When a leap second was added: the first days of 2006, 2009, July 2012, July 2015, and 2017.
_LEAPS = (1_136_073_600, 1_230_768_000, 1_341_100_800, 1_435_708_800, 1_483_228_800)
# The years from 2000 to 2049: what is farther away was not meant.
_EARLIEST, _LATEST = 630_000_000 * _S, 2_200_000_000 * _S

_TO_GPS = {"adjusted": _ADJUSTED, "gps": 0}
_CLOCKS = {
    "week": "seconds of the GPS week",
    "adjusted": "GPS seconds less 10^9",
    "gps": "GPS seconds",
}


def clock_offset_ns(
    path: str, times: Span, track_path: str, stamps: Span
) -> tuple[int, Note | None]:
    """What is to be added to the times of points to get those of the trajectory [ns].

    Args:
        path: the file of points.
        times: first and last time of its points [ns].
        track_path: the trajectory.
        stamps: first and last stamp of it [ns].

    Returns:
        The offset, and a note where it is not 0.

    Raises:
        InputError: no clock lets them overlap, or several do.
    """
    if _overlap(times, stamps, 0):
        return 0, None
    found = dict(_candidates(times, stamps))
    if len(found) == 1:
        ((offset, words),) = found.items()
        text = f"{words}: {format_seconds(offset)} s are added to the former"
        return offset, Note(text, code="stamp.gps", severity="warning")
    where = f"{path}: its points are from {_words(times)}, the poses of {track_path} from "
    where += f"{_words(stamps)}: "
    if found:
        raise InputError(
            f"{where}several clocks of GPS would fit: say what to add to the times of the points "
            "with --clock-offset SECONDS (clock_offset_s=)"
        )
    raise InputError(
        f"{where}they overlap in no clock of GPS{_unix(times, stamps)}: say what to add to the "
        "times of the points with --clock-offset SECONDS (clock_offset_s=)"
    )


def clock_offset_of_utc_ns(
    path: str, times: Span, track_path: str, stamps: Span
) -> tuple[int, Note | None]:
    """The same for a trajectory whose stamps are seconds since 1970 in UTC [ns].

    Raises:
        InputError: as `clock_offset_ns`.
    """
    to_gps = _leap_seconds_ns(stamps[0]) - _GPS_EPOCH
    gps = stamps[0] + to_gps, stamps[1] + to_gps
    offset, note = clock_offset_ns(path, times, track_path, gps)
    if note is None:
        return -to_gps, None
    text = f"{note}, and its times are in UTC"
    return offset - to_gps, Note(text, code=note.code, severity=note.severity)


def _leap_seconds_ns(stamp: int) -> int:
    """What GPS is ahead of UTC at a time since 1970 [ns], from 1999 on."""
    return (13 + sum(stamp >= leap * _S for leap in _LEAPS)) * _S


def _candidates(times: Span, stamps: Span) -> Iterator[tuple[int, str]]:
    """Offsets by which two different clocks overlap, and which they are."""
    for mine in _CLOCKS:
        for theirs in _CLOCKS:
            offset = _offset(mine, times, theirs, stamps)
            if offset is not None and _overlap(times, stamps, offset):
                words = f"the points have {_CLOCKS[mine]} and the trajectory {_CLOCKS[theirs]}"
                yield offset, words


def _offset(mine: str, times: Span, theirs: str, stamps: Span) -> int | None:
    """From one clock to another, the week being that of the other; None where neither can be."""
    if mine == theirs:
        return None
    if mine == "week":
        back = _offset("gps", stamps, "week", times) if theirs == "gps" else None
        back = _offset("adjusted", stamps, "week", times) if theirs == "adjusted" else back
        return None if back is None else -back
    gps = times[0] + _TO_GPS[mine]
    if not _EARLIEST <= gps <= _LATEST:
        return None
    if theirs == "week":
        return _TO_GPS[mine] - gps // _WEEK * _WEEK if _may_be_week(stamps) else None
    return _TO_GPS[mine] - _TO_GPS[theirs]


def _may_be_week(span: Span) -> bool:
    return span[0] >= 0 and span[1] < _WEEK + _WEEK // 7


def _overlap(times: Span, stamps: Span, offset: int) -> bool:
    return times[0] + offset <= stamps[1] and stamps[0] <= times[1] + offset


def _unix(times: Span, stamps: Span) -> str:
    """What to try where the trajectory may be in Unix time."""
    for to_gps in (0, _ADJUSTED):
        offset = to_gps + _GPS_EPOCH - _LEAP
        if _overlap(times, stamps, offset):
            return f" (with 18 leap seconds Unix time is --clock-offset {offset // _S})"
    return ""


def _words(span: Span) -> str:
    return f"{span[0] // _S} to {span[1] // _S} s"
