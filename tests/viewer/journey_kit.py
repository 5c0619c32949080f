# SPDX-License-Identifier: Apache-2.0
"""Logs of scans at will, and the payload of a log read slowly, number by number."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

from oddsmap.scans.memory_log import LoadedLog
from tests.viewer.payload_kit import numbers_of, parts_of


def log_of(scans: Sequence[Any], **sensor: float) -> LoadedLog:
    """A log in memory; its scans are a second apart."""
    stamped = [
        dataclasses.replace(scan, stamp_ns=10**18 + i * 10**9) for i, scan in enumerate(scans)
    ]
    return LoadedLog("run.log", "test", sensor, Counter(), (), tuple(stamped))


class ReadJourney(NamedTuple):
    facts: dict[str, Any]
    places: list[tuple[float, ...] | None]
    yaw: list[float]
    pitch: list[float]
    times: list[float | None]
    sensors: list[str]
    ends: list[list[tuple[float, ...]]]
    """Ends of beams from the sensor, of each scan."""
    returned: list[list[bool]]


def read_payload(payload: bytes) -> ReadJourney:
    """What the page makes of it."""
    facts, sections = parts_of(payload)

    def steps(name: str) -> list[int]:
        found, at = [], 0
        for step in numbers_of(sections, name, 4):
            at = (at + step) % 2**32
            found.append(at)
        return found

    def angles(name: str) -> list[float]:
        return [2 * math.pi * turn / 65536 for turn in numbers_of(sections, name, 2)]

    axes = [steps(name) for name in "xyz"[: facts["axes"]]]
    known = numbers_of(sections, "known", 1)
    places = [
        tuple(lo + facts["unit"] * n for lo, n in zip(facts["lo"], row, strict=True))
        if there
        else None
        for row, there in zip(zip(*axes, strict=True), known, strict=True)
    ]
    stamped = numbers_of(sections, "stamped", 1)
    times = [
        facts["time_unit"] * time if there else None
        for time, there in zip(steps("time"), stamped, strict=True)
    ]
    whose = [facts["sensors"][n] for n in numbers_of(sections, "whose", 4)]
    yaw, pitch = angles("yaw"), angles("pitch")
    ends: list[list[tuple[float, ...]]] = []
    returned: list[list[bool]] = []
    if facts["kept"]:
        azimuth, seen = angles("azimuth"), numbers_of(sections, "returned", 1)
        up = angles("elevation") if facts["axes"] == 3 else [0.0] * len(azimuth)
        reach = [facts["reach_unit"] * n for n in numbers_of(sections, "reach", 2)]
        at = 0
        for scan, count in enumerate(numbers_of(sections, "count", 2)):
            ways = []
            for i in range(at, at + count):
                flat, turn = reach[i] * math.cos(up[i]), yaw[scan] + azimuth[i]
                way = (flat * math.cos(turn), flat * math.sin(turn), reach[i] * math.sin(up[i]))
                ways.append(way[: facts["axes"]])
            ends.append(ways)
            returned.append([bool(one) for one in seen[at : at + count]])
            at += count
        assert at == len(azimuth)
    return ReadJourney(facts, places, yaw, pitch, times, whose, ends, returned)
