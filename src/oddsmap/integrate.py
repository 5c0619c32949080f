# SPDX-License-Identifier: Apache-2.0
"""Scans and a sensor model to evidence: the mapping itself.

for each batch of scans:                    # workers.py, shared among threads
segments = sensor.segments(batch)       # sensors/beam.py: metres, map frame
cells = to_cells(segments)              # cells.py: position / resolution
integrator.add(cells)                   # integrate2d.py, integrate3d.py: exact votes
"""

from __future__ import annotations

import dataclasses
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from itertools import chain

import numpy as np

from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence import EvidenceMap
from oddsmap.poses import Pose2, Pose3
from oddsmap.scan import Log, Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.depth_camera import DepthScan, PinholeCamera
from oddsmap.workers import Team

__all__ = ["Report", "add_log", "add_scans", "build_map"]

SENSOR_SAYS = ("range_min", "range_max")
"""What a log may say of its sensor that is a field of the sensor model."""

METHODS = ("rays", "projective")


@dataclass(slots=True)
class Report:
    """What became of the scans: counts, and wall times [s]."""

    scans: int = 0
    beams: int = 0
    skipped: Counter[str] = field(default_factory=Counter)
    integrate_s: float = 0.0
    compile_s: float = 0.0
    read_s: float = 0.0

    def add(self, scans: int, beams: int, skipped: Counter[str]) -> None:
        """Count one batch."""
        self.scans += scans
        self.beams += beams
        self.skipped += skipped


def build_map(
    log: Log | Iterable[Scan | DepthScan],
    resolution: float,
    *,
    sensor: BeamSensor | None = None,
    votes: str = "scan",
    method: str = "rays",
    threads: int = 1,
    progress: Callable[[int], None] | None = None,
) -> EvidenceMap:
    """Map a log: the whole way from readings to evidence.

    Args:
        log: what `open_log` gives, or any scans.
        resolution: side of a cell [m].
        sensor: the sensor model; by default a `BeamSensor` with what the log says of its sensor.
        votes: "scan": a cell gets at most one vote a scan, hits before passes (the textbook
            filter: one update a measurement). "beam": every beam votes, weights add up.
        method: how depth images free cells. "rays": exactly, along the ray of every pixel;
            "projective": those whose centre lies before what its pixel sees, which is many times
            as fast and approximate (docs/method-depth.md). Hits are the same.
        threads: how many to work with; changes no bit of the result.
        progress: called with the number of scans done so far.

    Returns:
        The map, of the plane or of space as the scans are; its `report` says what was used and
        what was skipped.

    Raises:
        InputError: no usable scan, or scans of the plane and of space together.
        ConfigError: a parameter outside its range.
        MapTooLargeError: the map, or one scan of it, would not fit in memory.
    """
    if sensor is None:
        said = getattr(log, "sensor", {})
        sensor = BeamSensor(**{name: said[name] for name in SENSOR_SAYS if name in said})
    scans = _scans_of(log, method)
    first = next(scans, None)
    ndim = _ndim(first)
    evidence = EvidenceMap(resolution, votes=votes, sensor=sensor, ndim=ndim)
    ahead = scans if first is None else chain([first], scans)
    evidence.report = add_log(
        evidence, log, scans=ahead, method=method, threads=threads, progress=progress
    )
    return evidence


def add_log(
    evidence: EvidenceMap,
    log: Log | Iterable[Scan | DepthScan],
    *,
    scans: Iterable[Scan | DepthScan] | None = None,
    sensor: BeamSensor | None = None,
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
        sensor=dataclasses.asdict(used),
        method=method,
    )
    return report


def add_scans(
    evidence: EvidenceMap,
    scans: Iterable[Scan | DepthScan],
    *,
    sensor: BeamSensor | None = None,
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
    team = Team(evidence, sensor, threads, method)
    wide = sensor.hit_width > 0
    report = Report(compile_s=_compile(evidence.ndim, evidence.votes, wide, method))
    for scan_count, beam_count, skipped in team.run(scans):
        report.add(scan_count, beam_count, skipped)
        if progress is not None:
            progress(report.scans + sum(skipped[k] for k in skipped if k.startswith("scan.")))
    report.integrate_s, report.read_s = team.integrate_s, team.read_s
    return report


def _scans_of(log: Log | Iterable[Scan | DepthScan], method: str) -> Iterator[Scan | DepthScan]:
    """The scans of a log; its depth images as such where the method asks for them."""
    images = getattr(log, "depth_scans", None) if method == "projective" else None
    return iter(log) if images is None else iter(images())


def _ndim(scan: Scan | DepthScan | None) -> int:
    if scan is None:
        return 2
    return 3 if isinstance(scan, DepthScan) else scan.directions.shape[1]


def _compile(ndim: int, votes: str, wide: bool, method: str) -> float:
    """Compile what a map needs, or load it from the cache; returns the seconds that took."""
    started = time.perf_counter()
    _compile_once(ndim, votes == "beam" or wide, method)
    return time.perf_counter() - started


@cache
def _compile_once(ndim: int, weights: bool, method: str) -> None:
    # A toy map goes through the same kernels.
    sensor = BeamSensor(hit_width=1.0 if weights else 0.0)
    pose = Pose2(0.5, 0.5, 0.0) if ndim == 2 else Pose3(np.eye(3), np.full(3, 0.5))
    toy = EvidenceMap(1.0, sensor=sensor, ndim=ndim)
    scan: Scan | DepthScan = Scan(pose, np.eye(ndim), np.full(ndim, 3.0))
    if method == "projective" and isinstance(pose, Pose3):
        camera = PinholeCamera(2.0, 2.0, 1.5, 1.5, width=4, height=4)
        scan = DepthScan(pose, np.full((4, 4), 3.0, np.float32), camera)
    for _ in Team(toy, sensor, 1, method).run([scan]):
        pass
    toy.tiles.merge(toy.tiles)
