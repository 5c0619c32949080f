# SPDX-License-Identifier: Apache-2.0
"""Scans and a sensor model to evidence: the mapping itself.

for each batch of scans:                # threads.py: shared among threads
integrator.add(batch)               # integrator.py: which class
segments = sensor.segments()    # sensors/beam.py: metres, map frame
cells = to_cells(segments)      # to_cells.py: position / resolution
votes into tiles                # rays2d.py, rays3d.py: exact
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.evidence.evidence import Evidence
from oddsmap.integrate.threads import WorkerPool
from oddsmap.integrate.toy_map import compile_kernels
from oddsmap.limits import memory_for
from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.given_scans import scans_alone, scans_given
from oddsmap.scans.grid_scan import GridScan
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.report import Report
from oddsmap.sensors.registry import Sensor, settings_of

__all__ = ["add_log", "add_scans", "facts_of", "ndim_of", "warn_of_no_returns"]


def add_log(
    evidence: Evidence,
    log: Log | Iterable[Measurement],
    *,
    scans: Iterable[Measurement] | None = None,
    sensor: Sensor | None = None,
    method: str = "rays",
    threads: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Add a whole log to a map and note it in the map's provenance.

    Arguments and errors as in `build_map`; `sensor` is by default the map's, and `scans` are the
    log's scans, if reading them has already begun.
    """
    source = log if scans is None else scans
    path = getattr(log, "path", None)
    try:
        report = add_scans(
            evidence, source, sensor=sensor, method=method, threads=threads, progress=progress
        )
    except MapTooLargeError as error:
        raise MapTooLargeError(f"{path}: {error}" if path else str(error)) from None
    report.skipped = Counter(getattr(log, "skipped", Counter())) + report.skipped
    if report.scans == 0:
        reasons = ", ".join(f"{n} x {why}" for why, n in report.skipped.most_common())
        raise InputError(
            f"{path or 'the scans'}: no usable scan ({reasons or 'there are none'}); nothing to map"
        )
    used = sensor or evidence.sensor
    evidence.record(
        path,
        scans=report.scans,
        beams=report.beams,
        skipped=dict(report.skipped),
        **facts_of(evidence, used, method),
    )
    return report


def facts_of(evidence: Evidence, sensor: Sensor, method: str) -> dict[str, Any]:
    """What the provenance says of how scans were added."""
    facts = {"sensor": settings_of(sensor), "method": method}
    own = evidence.config.map
    if own.half_life_scans is not None:
        return {**facts, "half_life_scans": own.half_life_scans, "ref_scan": own.ref_scan}
    if own.half_life is None:
        return facts
    return {**facts, "half_life": own.half_life, "t_ref_ns": own.t_ref_ns}


def add_scans(
    evidence: Evidence,
    scans: Measurement | Iterable[Measurement],
    *,
    sensor: Sensor | None = None,
    method: str = "rays",
    threads: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Add scans to a map; their order changes no bit.

    Arguments and errors as in `build_map`, except that no usable scan is no error here;
    `sensor` is by default the map's.
    """
    if threads < 1:
        raise ConfigError(f"threads: at least 1 is needed, got {threads}")
    sensor = sensor or evidence.sensor
    given: Iterable[Measurement] = scans_given(scans)
    with memory_for("what the scans need", "use a coarser resolution, a range_max, fewer threads"):
        workers = WorkerPool(evidence, sensor, threads, method)
        report = Report(compile_s=compile_kernels(evidence, sensor, method))
        for scan_count, beam_count, skipped in workers.run(warn_of_no_returns(given, sensor)):
            report.add(scan_count, beam_count, skipped)
            if progress is not None:
                skipped_scans = sum(
                    n for reason, n in report.skipped.items() if reason.startswith("scan.")
                )
                progress(report.scans + skipped_scans)
    report.integrate_s, report.read_s = workers.integrate_s, workers.read_s
    return report


def warn_of_no_returns(scans: Iterable[Measurement], sensor: Sensor) -> Iterator[Measurement]:
    """The scans; warns where they know what a no-return looks like and the sensor does not."""
    rest = scans_alone(scans)
    for first in rest:
        written = getattr(first, "stated", {}).get("range_max")
        if written is not None and getattr(sensor, "range_max", written) is None:
            warnings.warn(
                f"these scans come from a log that states range_max {written:g} m, and the sensor "
                "model has none: where nothing was seen it marks an obstacle; give "
                f"range_max={written:g}",
                stacklevel=3,
            )
        yield first
        break
    yield from rest


def ndim_of(scan: Measurement | None) -> int:
    """2 or 3, the dimension of the map that a measurement goes into; 2 without one."""
    if scan is None or isinstance(scan, GridScan):
        return 2
    return 3 if isinstance(scan, DepthScan) else scan.directions.shape[1]
