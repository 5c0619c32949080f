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
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import chain
from typing import Any

import numpy as np

from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import EvidenceMap
from oddsmap.integrate.forgetting import last_stamp
from oddsmap.integrate.threads import Team
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.scan import Log, Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.overhead import GridScan, OverheadSensor
from oddsmap.sensors.registry import KINDS, Measurement, Sensor

__all__ = ["Report", "add_log", "add_scans", "build_map", "said_of_sensor"]

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
    log: Log | Iterable[Measurement],
    resolution: float,
    *,
    sensor: Sensor | None = None,
    votes: str | None = None,
    half_life: float | None = None,
    t_ref_ns: int | None = None,
    path_lengths: bool = False,
    method: str = "rays",
    threads: int = 1,
    progress: Callable[[int], None] | None = None,
) -> EvidenceMap:
    """Map a log: the whole way from readings to evidence.

    Args:
        log: what `open_log` gives, or any scans.
        resolution: side of a cell [m].
        sensor: the sensor model; by default what the log says of its sensor: an `OverheadSensor`
            for grid scans, a `ConeSensor` where it says that beams are wide, else a `BeamSensor`.
        votes: "scan": a cell gets at most one vote a scan, hits before passes (the textbook
            filter: one update a measurement). "beam": every beam votes, weights add up. Default:
            "beam" for cones, where each echo is a measurement, else "scan".
        half_life: evidence of this age weighs half [s], for worlds that change; every scan needs
            a stamp. None: it never fades.
        t_ref_ns: the time at which it weighs 1 [ns]; default: that of the last scan, for which
            the log is gone through twice.
        path_lengths: True: also keep the length of the beams inside each cell, for
            `EvidenceMap.decay_rate`; needs votes "beam".
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
    if half_life is not None and t_ref_ns is None:
        log = list(log) if isinstance(log, Iterator) else log
        t_ref_ns = last_stamp(_scans_of(log, method))
    scans = _scans_of(log, method)
    first = next(scans, None)
    if sensor is None:
        said = said_of_sensor(log, first=first)
        sensor = KINDS[said.pop("kind")](**said)
    ndim = _ndim(first)
    evidence = EvidenceMap(
        resolution, votes=votes, half_life=half_life, t_ref_ns=t_ref_ns,
        path_lengths=path_lengths, sensor=sensor, ndim=ndim,
    )  # fmt: skip
    ahead = scans if first is None else chain([first], scans)
    evidence.report = add_log(
        evidence, log, scans=ahead, method=method, threads=threads, progress=progress
    )
    return evidence


def said_of_sensor(
    log: object, kind: str | None = None, *, first: Measurement | None = None
) -> dict[str, Any]:
    """What a log says of its sensor, as fields of the sensor model, with its `kind`.

    Args:
        log: any log.
        kind: the kind of sensor; default: as the log's readings are.
        first: the first of them.
    """
    said: Mapping[str, float] = getattr(log, "sensor", {})
    if kind is None and isinstance(first, GridScan):
        kind = OverheadSensor.kind
    elif kind is None:
        kind = ConeSensor.kind if "cone_deg" in said else BeamSensor.kind
    fields = {field.name for field in dataclasses.fields(KINDS[kind])}
    return {"kind": kind} | {name: value for name, value in said.items() if name in fields}


def add_log(
    evidence: EvidenceMap,
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


def _forgets(evidence: EvidenceMap) -> dict[str, float | int | None]:
    """Of a map whose evidence fades: how fast, and from when."""
    own = evidence.config.map
    if own.half_life is None:
        return {}
    return {"half_life": own.half_life, "t_ref_ns": own.t_ref_ns}


def add_scans(
    evidence: EvidenceMap,
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


def _compile(evidence: EvidenceMap, sensor: Sensor, method: str) -> float:
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
    toy = EvidenceMap(1.0, sensor=sensor, votes=votes, path_lengths=lengths, ndim=ndim)
    for _ in Team(toy, sensor, 1, method).run([scan]):
        pass
    toy.tiles.merge(toy.tiles)
