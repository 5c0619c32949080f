# SPDX-License-Identifier: Apache-2.0
"""The whole way from a log to a map: which map it makes, and all of its scans into that."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Any, NamedTuple, TypedDict, TypeVar, Unpack

from oddsmap.evidence.evidence import Evidence
from oddsmap.integrate.add import add_log, ndim_of
from oddsmap.integrate.forgetting import last_number, last_stamp, numbered
from oddsmap.scans.given_scans import scans_alone, scans_given
from oddsmap.scans.log import Log, parts_of
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.report import Report
from oddsmap.sensors.registry import Sensor, agreeing, sensor_of_log

__all__ = ["MapOptions", "WorkOptions", "add_whole_log", "begin_map"]

E = TypeVar("E", bound=Evidence)


class MapOptions(TypedDict, total=False):
    """What may be said of the map that a log is to make: see `oddsmap.build_map`."""

    sensor: Sensor | None
    votes: str | None
    half_life: float | None
    t_ref_ns: int | None
    half_life_scans: float | None
    ref_scan: int | None
    path_lengths: bool


class WorkOptions(TypedDict, total=False):
    """How a map is made: see `oddsmap.build_map`."""

    method: str
    threads: int
    progress: Callable[[int], None] | None


class _Part(NamedTuple):
    """One log, or the scans of one that have a sensor in common."""

    log: Any
    scans: Iterable[Measurement] | None
    sensor: Sensor | None


def begin_map(
    kind: type[E],
    log: Log | Measurement | Iterable[Measurement],
    resolution: float,
    **options: Unpack[MapOptions],
) -> tuple[E, list[_Part]]:
    """The empty map that a log makes, and what is to be added to it with `add_whole_log`.

    Args:
        kind: of the map.
        log: as in `oddsmap.build_map`, as are the others, and what is raised.
        resolution: side of a cell [m].
        options: see `MapOptions`.
    """
    sensor, own = options.get("sensor"), dict(options)
    taken: Any = scans_given(log)
    if options.get("half_life") is not None and options.get("t_ref_ns") is None:
        taken = list(taken) if isinstance(taken, Iterator) else taken
        own["t_ref_ns"] = last_stamp(taken)
    if options.get("half_life_scans") is not None:
        if not hasattr(taken, "sensors"):
            taken = list(scans_alone(taken))
            if all(scan.number is None for scan in taken):
                taken = list(numbered(taken))
        if options.get("ref_scan") is None:
            own["ref_scan"] = last_number(taken)
    # Sensors that state different things are one model each; whoever gives the sensor has decided.
    taken, *others = parts_of(taken) if sensor is None else [taken]
    scans = scans_alone(taken)
    first = next(scans, None)
    ahead = scans if first is None else chain([first], scans)
    if sensor is None:
        own["sensor"] = sensor_of_log(taken, first=first)
        if not hasattr(taken, "sensor"):
            ahead = agreeing(ahead, getattr(first, "stated", {}))
    # Settings of several types, by their names.
    evidence = kind(resolution, ndim=ndim_of(first), **own)  # type: ignore[arg-type]
    rest = [_Part(part, None, sensor_of_log(part)) for part in others]
    return evidence, [_Part(taken, ahead, None), *rest]


def add_whole_log(evidence: Evidence, parts: list[_Part], **options: Unpack[WorkOptions]) -> Report:
    """Add what `begin_map` found to the map that it made; what was used, and what was skipped."""
    progress, total = options.get("progress"), Report()
    for number, part in enumerate(parts):
        own = dict(options)
        if progress is not None:
            own["progress"] = _from(total.scans, progress)
        report = add_log(
            evidence, part.log, scans=part.scans, sensor=part.sensor,
            **own,  # type: ignore[arg-type]  # of several types, by their names
        )  # fmt: skip
        if number == 0:
            total = report
        else:
            total.include(report)
    return total


def _from(before: int, progress: Callable[[int], None]) -> Callable[[int], None]:
    """Progress that goes on where another log ended."""
    return lambda done: progress(before + done)
