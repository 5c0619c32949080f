# SPDX-License-Identifier: Apache-2.0
"""Scans and a sensor model to evidence: the mapping itself.

    for each batch of scans:
        segments = sensor.segments(batch)       # metres, map frame
        add_segments(evidence, segments)        # exact cells, integer votes

Batches may be shared among threads, each with tiles of its own that are added up at the end:
integer addition commutes, so threads and order change no bit.
"""

from __future__ import annotations

import dataclasses
import queue
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence import EvidenceMap
from oddsmap.scan import Log, Scan
from oddsmap.sensors.beam import BeamSensor

if TYPE_CHECKING:
    from oddsmap.integrate2d import Integrator2D

__all__ = ["Report", "add_log", "build_map", "integrate"]

# Beams in one batch: enough that Python's share of the time is small, few enough that progress
# shows and Ctrl-C is answered at once.
_BATCH_BEAMS = 1 << 14

SENSOR_SAYS = ("range_min", "range_max")
"""What a log may say of its sensor that is a field of the sensor model."""


@dataclass(slots=True)
class Report:
    """What became of the scans: counts, and wall times [s]."""

    scans: int = 0
    beams: int = 0
    skipped: Counter[str] = field(default_factory=Counter)
    integrate_s: float = 0.0
    compile_s: float = 0.0

    def add(self, scans: int, beams: int, skipped: Counter[str]) -> None:
        """Count one batch."""
        self.scans += scans
        self.beams += beams
        self.skipped += skipped


def build_map(
    log: Log | Iterable[Scan],
    resolution: float,
    *,
    sensor: BeamSensor | None = None,
    votes: str = "scan",
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
        threads: how many to work with; changes no bit of the result.
        progress: called with the number of scans done so far.

    Returns:
        The map; `map.report` says what was used and what was skipped.

    Raises:
        InputError: no usable scan, or scans of space (3D).
        ConfigError: a parameter outside its range.
        MapTooLargeError: the map, or one scan of it, would not fit in memory.
    """
    if sensor is None:
        said = getattr(log, "sensor", {})
        sensor = BeamSensor(**{name: said[name] for name in SENSOR_SAYS if name in said})
    evidence = EvidenceMap(resolution, votes=votes, sensor=sensor)
    evidence.report = add_log(evidence, log, threads=threads, progress=progress)
    return evidence


def add_log(
    evidence: EvidenceMap,
    log: Log | Iterable[Scan],
    *,
    sensor: BeamSensor | None = None,
    threads: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Add a whole log to a map and note it in the map's provenance.

    Arguments and errors as in `build_map`; `sensor` is by default the map's.
    """
    report = integrate(evidence, log, sensor=sensor, threads=threads, progress=progress)
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
    )
    return report


def integrate(
    evidence: EvidenceMap,
    scans: Iterable[Scan],
    *,
    sensor: BeamSensor | None = None,
    threads: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Add scans to a map; their order changes no bit.

    Arguments and errors as in `build_map`, except that no usable scan is no error here;
    `sensor` is by default the map's.
    """
    from oddsmap.integrate2d import Integrator2D, compile_kernels

    if threads < 1:
        raise ConfigError(f"threads: at least 1 is needed, got {threads}")
    sensor = sensor or evidence.sensor
    report = Report(compile_s=compile_kernels(evidence.votes, sensor))
    started = time.perf_counter()
    workers = [Integrator2D(evidence, sensor, evidence.tiles)]
    workers += [Integrator2D(evidence, sensor, evidence.new_tiles()) for _ in range(threads - 1)]
    for scan_count, beam_count, skipped in _run(workers, _batches(scans)):
        report.add(scan_count, beam_count, skipped)
        if progress is not None:
            progress(report.scans + sum(skipped[k] for k in skipped if k.startswith("scan.")))
    for worker in workers[1:]:
        for coords, units in worker.tiles.chunks():
            evidence.tiles.add(coords, units)
    report.integrate_s = time.perf_counter() - started
    return report


def _batches(scans: Iterable[Scan]) -> Iterator[list[Scan]]:
    batch: list[Scan] = []
    beams = 0
    for scan in scans:
        batch.append(scan)
        beams += len(scan.ranges)
        if beams >= _BATCH_BEAMS:
            yield batch
            batch, beams = [], 0
    if batch:
        yield batch


def _run(
    workers: Sequence[Integrator2D], batches: Iterator[list[Scan]]
) -> Iterator[tuple[int, int, Counter[str]]]:
    if len(workers) == 1:
        yield from map(workers[0].add, batches)
        return
    idle: queue.SimpleQueue[Integrator2D] = queue.SimpleQueue()
    for worker in workers:
        idle.put(worker)

    def work(batch: list[Scan]) -> tuple[int, int, Counter[str]]:
        worker = idle.get()
        try:
            return worker.add(batch)
        finally:
            idle.put(worker)

    with ThreadPoolExecutor(len(workers)) as pool:
        pending: set[Future[tuple[int, int, Counter[str]]]] = set()
        for batch in batches:
            pending.add(pool.submit(work, batch))
            if len(pending) > 2 * len(workers):
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        for future in pending:
            yield future.result()
