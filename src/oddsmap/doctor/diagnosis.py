# SPDX-License-Identifier: Apache-2.0
"""All that is tried with a log, in order: gross faults first, what they hide after them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from oddsmap.doctor.alternatives import AS_READ, IN_MAP, alternatives_of, lie_around_sensor
from oddsmap.doctor.clock import find_clock_offset
from oddsmap.doctor.examined import Examined, examine
from oddsmap.doctor.itself import doubts_of_itself
from oddsmap.doctor.mounting import find_yaw
from oddsmap.doctor.revisits import doubts_of_revisits
from oddsmap.doctor.stamps import doubts_of_stamps
from oddsmap.doctor.trial import Court, Verdict
from oddsmap.doctor.vertical import doubts_of_vertical
from oddsmap.plausibility.false_ring import doubts_of_no_returns
from oddsmap.plausibility.range_unit import doubts_of_ranges
from oddsmap.plausibility.upright import doubts_of_upright
from oddsmap.poses.pose import Pose3
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.note import Note
from oddsmap.short_repr import short_repr

__all__ = ["Diagnosis", "SensorFacts", "diagnose"]

# Faults that are looked for one after the other.
_ROUNDS = 3
# Fewer zeros than this share of readings are dropouts.
_ZEROS = 0.01
# Scans before the first pose and after the last are usual, as long as they are fewer than this.
_UNPLACED = 0.02


@dataclass(frozen=True, slots=True)
class SensorFacts:
    """What was measured of a sensor.

    Args:
        sensor_id: of the log's sensors.
        scans: how many there are.
        places: at how many places along the log maps were made.
        information: what maps of some scans say of the beams of others there [nats per beam].
    """

    sensor_id: str
    scans: int
    places: int
    information: float

    __repr__ = short_repr


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What is wrong with a log.

    Args:
        findings: doubts, each with what was measured and what to do.
        sensors: what was measured of each sensor.
    """

    findings: tuple[Note, ...]
    sensors: tuple[SensorFacts, ...]

    __repr__ = short_repr


def diagnose(
    log: Log | Iterable[Measurement],
    *,
    range_max: float | None = None,
    body_from_sensor: Pose3 | None = None,
    progress: Callable[[int], None] | None = None,
) -> Diagnosis:
    """Look for what is wrong with a log: with its poses, its units, its times, its sensor.

    Other readings of the log are tried, and how well maps of some scans predict others decides. It
    says nothing where it is not sure.

    Args:
        log: what `open_log` returns, or any scans.
        range_max: a reading from here on is no return [m]; by default what the log says.
        body_from_sensor: how the sensor sits on the body whose poses were given, as in `open_log`.
        progress: called with the number of scans read so far.

    Returns:
        What was found, the gravest first.
    """
    stated: Any = getattr(log, "sensor", {}).get("range_max", math.inf)
    limit = float(stated if range_max is None else range_max)
    count = getattr(log, "scan_count", None)
    sensors = max(1, len(getattr(log, "sensors", ())))
    seen = examine(log, limit, None if count is None else count // sensors, progress)
    findings: list[Note] = []
    facts = []
    with np.errstate(all="ignore"):  # absurd numbers compare as what they are: far, or not at all
        for each in seen:
            found, information, places = _examined(each, body_from_sensor)
            if not getattr(log, "points_in_map", False):  # where ranges are those of an aircraft
                found = [*doubts_of_ranges(each.waypoints), *found]
            facts.append(SensorFacts(each.sensor_id, len(each.poses), places, information))
            where = f"{each.sensor_id}: " if len(seen) > 1 else ""
            findings += [Note(where + n, code=n.code, severity="warning") for n in _once(found)]
    # Those of the reader, but for what is measured here.
    findings += [
        note
        for note in getattr(log, "notes", ())
        if note.severity == "warning" and note.code != "stamp.order"
    ]
    findings += _unplaced(log, sum(len(each.poses) for each in seen))
    return Diagnosis(tuple(findings), tuple(facts))


def _examined(seen: Examined, mounted: Pose3 | None) -> tuple[list[Note], float, int]:
    """The findings of one sensor, and what its maps said of held-out beams as it was read."""
    glances = [glance for group in seen.groups for glance in group]
    findings = [
        *doubts_of_no_returns(seen.waypoints, seen.way.range_max),
        *_doubts_of_zeros(seen),
        *doubts_of_stamps(seen),
    ]
    first = Court(seen.groups, AS_READ)
    as_read = first.try_out(AS_READ)
    form = _faults(seen, mounted)
    findings += [_named(verdict) for verdict in form]
    if not form:
        findings += doubts_of_upright(glances)
    findings += [*doubts_of_vertical(seen), *doubts_of_itself(seen), *doubts_of_revisits(seen)]
    return findings, as_read.now, as_read.places


def _faults(seen: Examined, mounted: Pose3 | None) -> list[Verdict]:
    """Other readings that are right, one after the other: each is taken for what was meant."""
    found: list[Verdict] = []
    for _ in range(_ROUNDS):
        court = Court(seen.groups, AS_READ)
        alternatives = alternatives_of(seen.ndim, mounted)
        if lie_around_sensor(seen.waypoints):
            alternatives.append(IN_MAP)
        candidates = [
            court.best_of(alternatives),
            find_yaw(court, seen.ndim),
            find_clock_offset(seen, court),
        ]
        sure = [verdict for verdict in candidates if verdict is not None]
        if not sure:
            break
        best = max(sure, key=lambda verdict: verdict.then)
        found.append(best)
        seen.read_as(best.alternative)
    return found


def _named(verdict: Verdict) -> Note:
    text = (
        f"are these {verdict.alternative.suspicion}? Maps of some scans would then say "
        f"{verdict.then:.2f} nats of each beam of others, and say {verdict.now:.2f} as it is: "
        f"better at {verdict.better} of {verdict.places} places, worse at {verdict.worse}. If so, "
        f"{verdict.alternative.remedy}"
    )
    return Note(text, code=verdict.alternative.code, severity="warning")


def _doubts_of_zeros(seen: Examined) -> list[Note]:
    if seen.zeros < max(1.0, _ZEROS * seen.beams):
        return []
    text = (
        f"{seen.zeros / seen.beams:.0%} of the readings are 0: they say nothing, neither free nor "
        "occupied. If the sensor writes 0 where it sees nothing, write +Inf there, and beams clear"
    )
    return [Note(text, code="range.zero", severity="warning")]


def _unplaced(log: Any, used: int) -> list[Note]:
    count = int(getattr(log, "skipped", {}).get("scan.no_pose", 0))
    if count <= _UNPLACED * (count + used):
        return []
    text = f"{count} of {count + used} scans have no pose: do scans and poses use one clock, and "
    text += "do poses cover the whole time?"
    return [Note(text, code="scan.no_pose", severity="warning")]


def _once(findings: list[Note]) -> list[Note]:
    """Of findings of one code the first."""
    return list({note.code: note for note in reversed(findings)}.values())[::-1]
