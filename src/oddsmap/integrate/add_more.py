# SPDX-License-Identifier: Apache-2.0
"""More scans into a map that somebody holds: what does not fit it is said."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from oddsmap.errors import ConfigError, InputError, shown
from oddsmap.evidence.evidence import Evidence
from oddsmap.integrate.add import add_log, add_scans, facts_of, ndim_of
from oddsmap.integrate.forgetting import numbered
from oddsmap.scans.given_scans import scans_alone, scans_given
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.report import Report
from oddsmap.sensors.registry import Sensor

__all__ = ["add_more"]


def add_more(
    evidence: Evidence,
    scans: Measurement | Iterable[Measurement] | Log,
    *,
    number: int | None = None,
    sensor: Sensor | None = None,
    method: str = "rays",
    threads: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Add a scan, some, or a log, and note it in the map's provenance.

    Scans without a log are noted as one source, however many calls add them. Arguments and errors
    as in `EvidenceMap.add`.
    """
    given: Any = scans_given(scans)
    if number is not None:
        _check_number(number, evidence, given)
        whole = isinstance(given, list | tuple)
        given = numbered(scans_alone(given), number)
        given = list(given) if whole else given
    if isinstance(given, list | tuple):
        for _ in _fitting(given, evidence, sensor):  # all of them before any is added
            pass
    fitting = _fitting(given, evidence, sensor)
    if hasattr(given, "sensors"):
        return add_log(
            evidence, given, scans=fitting, sensor=sensor, method=method, threads=threads,
            progress=progress,
        )  # fmt: skip
    report = add_scans(
        evidence, fitting, sensor=sensor, method=method, threads=threads, progress=progress
    )
    _note(evidence, report, facts_of(evidence, sensor or evidence.sensor, method))
    return report


def _check_number(number: int, evidence: Evidence, given: object) -> None:
    if evidence.config.map.half_life_scans is None:
        raise ConfigError(
            f"number {number} says how old a scan is where map.half_life_scans lets evidence "
            "fade, which this map does not: leave it out"
        )
    if not isinstance(number, int | np.integer) or number < 0:
        raise ConfigError(f"number of the first scan in its log: 0 or above, got {shown(number)}")
    if hasattr(given, "sensors"):
        raise ConfigError(f"number {number}: the scans of a log know their own; leave it out")


def _fitting(
    scans: Iterable[Measurement], evidence: Evidence, sensor: Sensor | None
) -> Iterator[Measurement]:
    """The scans, each of the map's dimension and of a beam that the sensor model can take."""
    used = sensor or evidence.sensor
    doubted = sensor is not None  # whoever gives it for these scans has decided
    for number, scan in enumerate(scans_alone(scans)):
        d = ndim_of(scan)
        if d != evidence.ndim:
            raise InputError(
                f"scan {number} is {d}D, the map {evidence.ndim}D: make the map with ndim={d}, or "
                "leave it to build_map"
            )
        width = getattr(scan, "stated", {}).get("cone_deg")
        if width is not None and not doubted:
            own = getattr(used, "cone_deg", None)
            if own is None:
                raise InputError(
                    f"scan {number} is of a beam {width:g} deg wide, the map's sensor is a "
                    f'"{used.kind}": make the map with sensor=ConeSensor(cone_deg={width:g})'
                )
            if own != width:
                doubted = True
                warnings.warn(
                    f"scan {number} is of a beam {width:g} deg wide, the map's sensor says "
                    f"{own:g}, which counts",
                    stacklevel=2,
                )
        yield scan


def _note(evidence: Evidence, report: Report, facts: dict[str, Any]) -> None:
    """Add to the last entry of the provenance where it says the same of other scans."""
    counts = {"scans": report.scans, "beams": report.beams}
    evidence.record(None, **counts, skipped=dict(report.skipped), **facts)
    if len(evidence.provenance) < 2:
        return
    last, new = evidence.provenance[-2:]
    if last.keys() == new.keys() and all(
        last[name] == new[name] for name in new if name not in (*counts, "skipped")
    ):
        for name in counts:
            new[name] += last[name]
        new["skipped"] = dict(Counter(last["skipped"]) + Counter(new["skipped"]))
        del evidence.provenance[-2]
