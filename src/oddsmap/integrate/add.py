# SPDX-License-Identifier: Apache-2.0
"""Scans and a sensor model to evidence: the mapping itself.

for each batch of scans:                    # threads.py, shared among threads
segments = sensor.segments(batch)       # sensors/beam.py: metres, map frame
cells = to_cells(segments)              # to_cells.py: position / resolution
integrator.add(cells)                   # rays2d.py, rays3d.py: exact votes
"""

from __future__ import annotations

import dataclasses
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import cache

import numpy as np

from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.integrate.threads import Team
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.grid_scan import GridScan
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.report import Report
from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.overhead import OverheadSensor
from oddsmap.sensors.registry import Sensor

__all__ = ["add_log", "add_scans"]

METHODS = ("rays", "projective")


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
    log's, where they have been begun to read already.
    """
    source = _scans_of(log, method) if scans is None else scans
    report = add_scans(
        evidence, source, sensor=sensor, method=method, threads=threads, progress=progress
    )
    report.skipped = Counter(getattr(log, "skipped", Counter())) + report.skipped
    path = getattr(log, "path", None)
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
        sensor={"kind": used.kind, **dataclasses.asdict(used)},
        method=method,
        **_forgets(evidence),
    )
    return report


def _forgets(evidence: Evidence) -> dict[str, float | int | None]:
    """Of a map whose evidence fades: how fast, and from when."""
    own = evidence.config.map
    if own.half_life is None:
        return {}
    return {"half_life": own.half_life, "t_ref_ns": own.t_ref_ns}


def add_scans(
    evidence: Evidence,
    scans: Iterable[Measurement],
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
    if method not in METHODS:
        raise ConfigError(f'method is "rays" or "projective", got {method!r}')
    if method == "projective" and evidence.ndim != 3:
        raise InputError('method "projective" is for depth images (DepthScan) and maps of space')
    sensor = sensor or evidence.sensor
    if method == "projective" and not isinstance(sensor, BeamSensor):
        raise ConfigError(
            f'method "projective" takes each pixel as a narrow beam, the sensor is of kind '
            f'{sensor.kind}: use method "rays"'
        )
    team = Team(evidence, sensor, threads, method)
    report = Report(compile_s=_compile(evidence, sensor, method))
    for scan_count, beam_count, skipped in team.run(scans):
        report.add(scan_count, beam_count, skipped)
        if progress is not None:
            lost = sum(n for reason, n in report.skipped.items() if reason.startswith("scan."))
            progress(report.scans + lost)
    report.integrate_s, report.read_s = team.integrate_s, team.read_s
    return report


def _scans_of(log: Log | Iterable[Measurement], method: str) -> Iterator[Measurement]:
    """The scans of a log; its depth images as such where the method asks for them."""
    images = getattr(log, "depth_scans", None) if method == "projective" else None
    return iter(log) if images is None else iter(images())


def _ndim(scan: Measurement | None) -> int:
    if scan is None or isinstance(scan, GridScan):
        return 2
    return 3 if isinstance(scan, DepthScan) else scan.directions.shape[1]


def _compile(evidence: Evidence, sensor: Sensor, method: str) -> float:
    """Compile what a map needs, or load it from the cache; returns the seconds that took."""
    started = time.perf_counter()
    weights = (
        evidence.votes == "beam"
        or evidence.config.map.half_life is not None
        or (isinstance(sensor, BeamSensor) and not sensor.whole_votes)
    )
    _compile_once(evidence.ndim, sensor.kind, weights, evidence.lengths is not None, method)
    return time.perf_counter() - started


@cache
def _compile_once(ndim: int, kind: str, weights: bool, lengths: bool, method: str) -> None:
    # A toy map goes through the same kernels.
    pose = Pose2(0.5, 0.5, 0.0) if ndim == 2 else Pose3(np.eye(3), np.full(3, 0.5))
    scan: Measurement = Scan(pose, np.eye(ndim), np.full(ndim, 3.0))
    sensor: Sensor = BeamSensor(fade=1.0 if weights else 0.0)
    if kind == ConeSensor.kind:
        sensor = ConeSensor(cone_deg=30.0)
    elif kind == OverheadSensor.kind and isinstance(pose, Pose2):
        sensor, scan = OverheadSensor(), GridScan(pose, np.eye(2), 1.0, (0.0, 0.0))
    elif method == "projective" and isinstance(pose, Pose3):
        camera = PinholeCamera(2.0, 2.0, 1.5, 1.5, width=4, height=4)
        scan = DepthScan(pose, np.full((4, 4), 3.0, np.float32), camera)
    votes = "beam" if lengths else "scan"
    toy = Evidence(1.0, sensor=sensor, votes=votes, path_lengths=lengths, ndim=ndim)
    for _ in Team(toy, sensor, 1, method).run([scan]):
        pass
    toy.tiles.merge(toy.tiles)
