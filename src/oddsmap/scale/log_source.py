# SPDX-License-Identifier: Apache-2.0
"""Logs that workers open: how, what they say of themselves, and what reading them has shown."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from oddsmap.errors import InputError
from oddsmap.integrate.forgetting import last_number, last_stamp
from oddsmap.readers import open_log
from oddsmap.recordings.recorded_log import RecordedLog
from oddsmap.scale.answers import answering, worker_name
from oddsmap.scans.found import Found
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.log import Log, SensorInfo, parts_of
from oddsmap.scans.log_items import LogItems
from oddsmap.scans.memory_log import BadLine
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = [
    "LogEnd", "LogHead", "LogSource", "close_logs", "end_of", "look_at", "number_to_count_from",
    "opened", "put_together", "time_to_count_from", "what_was_found",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class LogSource:
    """How to open a log.

    Args:
        token: tells it from all others, also from itself in another run.
        path: as the workers see it.
        reading: arguments of `oddsmap.open_log`.
        part: which of `parts_of` it; None: all of it.
    """

    token: str
    path: str
    reading: Mapping[str, Any]
    part: int | None = None


@dataclass(slots=True, eq=False, repr=False)
class LogHead(LogItems):
    """What a log says of itself, for whoever does not read it; satisfies `Log`.

    Args:
        path: as the workers see it.
        format: name of the format, for people.
        sensors: its sensors by id.
        sensor: what it states about all of them.
        scan_count: how many measurements there are; None where that is not known.
        skipped: what could not be read, by reason: once it has been mapped, all of it.
        notes: likewise.
        bad_lines: the first lines that could not be read, where the log knows them.
        points_in_map: poses do not move the points.
        by_number: its scans can be read without those before them.
        read_to_open: all of it is read to open it.
        first: the first measurement, without its other beams; None: there is none.
        first_beams: how many it had.
        inner: the same of each part, where there are several.
    """

    path: str
    format: str
    sensors: Mapping[str, SensorInfo]
    sensor: Mapping[str, float]
    scan_count: int | None
    skipped: Counter[str]
    notes: tuple[Note, ...]
    bad_lines: tuple[BadLine, ...]
    points_in_map: bool
    by_number: bool
    read_to_open: bool
    first: Any
    first_beams: int
    inner: list[LogHead] = field(default_factory=list)

    def parts(self) -> list[LogHead]:
        """As of every log that has parts."""
        return self.inner or [self]

    def __len__(self) -> int:
        """`scan_count`.

        Raises:
            TypeError: it is not known.
        """
        if self.scan_count is None:
            raise TypeError(f"{self.path}: the number of scans is not known before they are read")
        return self.scan_count

    def __iter__(self) -> Iterator[Any]:
        """The first measurement alone: the kind of all of them."""
        return iter(() if self.first is None else (self.first,))


class LogEnd(NamedTuple):
    """What a log says of itself once it has been read."""

    skipped: Counter[str]
    notes: tuple[Note, ...]
    bad_lines: tuple[BadLine, ...]


# Opening may take as long as reading, so each thread keeps the log that it has read last.
_kept: dict[int, tuple[str, Log]] = {}


def opened(source: LogSource) -> Any:
    """The log, or the part of it.

    Raises:
        InputError: it cannot be read here.
    """
    me = threading.get_ident()
    token, log = _kept.get(me, ("", None))
    if log is None or token != source.token:
        _kept.pop(me, None)
        if not Path(source.path).exists():
            raise InputError(
                f"{source.path}: no such file on worker {worker_name()}: workers read the logs "
                "themselves; give a path that each of them sees"
            )
        log = open_log(source.path, **source.reading)
        _kept[me] = source.token, log
    return log if source.part is None else parts_of(log)[source.part]


def close_logs() -> None:
    """Let go of all logs."""
    _kept.clear()


@answering
def look_at(source: LogSource) -> LogHead:
    """A task: what a log says of itself."""
    log = opened(source)
    parts = parts_of(log)
    head = _head_of(log)
    head.inner = [_head_of(part) for part in parts] if len(parts) > 1 else []
    return head


def _head_of(log: Any) -> LogHead:
    first = next(iter(log), None)
    what_was_found(log)
    return LogHead(
        path=log.path,
        format=log.format,
        sensors=dict(log.sensors),
        sensor=dict(log.sensor),
        scan_count=log.scan_count,
        skipped=Counter(log.skipped),
        notes=tuple(log.notes),
        bad_lines=tuple(getattr(log, "bad_lines", ())),
        points_in_map=bool(getattr(log, "points_in_map", False)),
        by_number=isinstance(log, LazyLog) or (isinstance(log, RecordedLog) and log.by_number),
        read_to_open=isinstance(log, RecordedLog),
        first=_thinned(first),
        first_beams=int(getattr(first, "size", 1)),
    )


def _thinned(scan: Any) -> Any:
    if not isinstance(scan, Scan):
        return scan
    few = Scan(scan.map_from_sensor, scan.directions[:1], scan.ranges[:1], scan.stamp_ns)
    for name in ("stated", "number", "sensor_id"):
        object.__setattr__(few, name, getattr(scan, name))
    return few


def what_was_found(log: Any) -> Found:
    """What reading some scans of a log has shown; the log forgets it."""
    return log.found.take() if isinstance(log, LazyLog | RecordedLog) else Found()


def end_of(log: Any) -> LogEnd:
    """What a log says once it has been read."""
    return LogEnd(Counter(log.skipped), tuple(log.notes), tuple(getattr(log, "bad_lines", ())))


@answering
def put_together(source: LogSource, found: Sequence[Found]) -> LogEnd:
    """A task: what a log says when its parts have been read apart."""
    log = opened(source)
    what_was_found(log)
    for each in found:
        log.found.include(each)
    end = end_of(log)
    what_was_found(log)
    return end


@answering
def time_to_count_from(source: LogSource) -> int:
    """A task: the latest stamp of a log [ns]."""
    return last_stamp(opened(source))


@answering
def number_to_count_from(sources: Iterable[LogSource]) -> int:
    """A task: the highest number of a scan of some logs, which differ."""
    return last_number(chain.from_iterable(opened(source) for source in sources))
