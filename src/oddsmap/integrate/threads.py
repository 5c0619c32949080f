# SPDX-License-Identifier: Apache-2.0
"""Batches of scans shared among threads, without changing a bit of the result.

Kernels release Python's lock, so ordinary threads run side by side. In 2D, where scans are
small and many, each thread has tiles of its own, and they are added up at the end. In 3D, where
a scan is long, threads mark on their own and add to one store by turns. Integer addition commutes.
"""

from __future__ import annotations

import queue
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait

from oddsmap.config.config import MapConfig
from oddsmap.errors import MapTooLargeError
from oddsmap.evidence.evidence import Evidence
from oddsmap.integrate.forgetting import by_weight
from oddsmap.integrate.integrator import Counts, Integrator, make_integrators
from oddsmap.integrate.long_readings import with_readings
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.registry import Sensor

__all__ = ["WorkerPool"]

# Beams in one batch: enough that Python's share of the time is small, few enough that progress
# shows and Ctrl-C is answered at once.
_BATCH_BEAMS = 1 << 14


class WorkerPool:
    """One integrator per thread, for one map.

    Args:
        evidence: the map to add to.
        sensor: the sensor model of the scans.
        threads: how many.
        method: "rays" or "projective", see `build_map`.
    """

    def __init__(
        self, evidence: Evidence, sensor: Sensor, threads: int, method: str = "rays"
    ) -> None:
        self._evidence, self._sensor = evidence, sensor
        self._map = evidence.config.map
        self._integrators = make_integrators(evidence, sensor, threads, method)
        self._busy_s = dict.fromkeys(range(threads), 0.0)
        self.read_s = 0.0
        """Time that was spent waiting for scans [s]: reading, where a log reads on demand."""
        self.merge_s = 0.0

    @property
    def integrate_s(self) -> float:
        """Wall time of integration alone [s]: the busiest thread's, and adding up."""
        return max(self._busy_s.values()) + self.merge_s

    def run(self, scans: Iterable[Measurement]) -> Iterator[Counts]:
        """Add all scans; gives the counts of each batch as it is done."""
        batches = self._batches(scans)
        if len(self._integrators) == 1:
            for batch in batches:
                yield self._add(0, batch)
            return
        idle: queue.SimpleQueue[int] = queue.SimpleQueue()
        for who in range(len(self._integrators)):
            idle.put(who)

        def work(batch: list[Measurement]) -> Counts:
            who = idle.get()
            try:
                return self._add(who, batch)
            finally:
                idle.put(who)

        with ThreadPoolExecutor(len(self._integrators)) as pool:
            pending: set[Future[Counts]] = set()
            for batch in batches:
                pending.add(pool.submit(work, batch))
                if len(pending) > 2 * len(self._integrators):
                    done, pending = wait(pending, return_when=FIRST_COMPLETED)
                    yield from (future.result() for future in done)
            for future in pending:
                yield future.result()
        started = time.perf_counter()
        for integrator in self._integrators:
            if integrator.tiles is not self._evidence.tiles:
                self._evidence.tiles.merge(integrator.tiles)
        self.merge_s = time.perf_counter() - started

    def _add(self, who: int, batch: list[Measurement]) -> Counts:
        started = time.perf_counter()
        try:
            if not self._map.forgets:
                return self._integrators[who].add(batch)
            return _add_by_weight(self._integrators[who], batch, self._map)
        except MapTooLargeError as error:
            raise with_readings(error, batch, self._sensor) from None
        finally:
            self._busy_s[who] += time.perf_counter() - started

    def _batches(self, scans: Iterable[Measurement]) -> Iterator[list[Measurement]]:
        batch: list[Measurement] = []
        beams = 0
        source = iter(scans)
        while True:
            started = time.perf_counter()
            scan = next(source, None)
            self.read_s += time.perf_counter() - started
            if scan is None:
                break
            batch.append(scan)
            beams += scan.size
            if beams >= _BATCH_BEAMS:
                yield batch
                batch, beams = [], 0
        if batch:
            yield batch


def _add_by_weight(
    integrator: Integrator, batch: Sequence[Measurement], settings: MapConfig
) -> Counts:
    """Add scans that weigh less the older they are."""
    scan_count, beam_count, skipped = 0, 0, Counter[str]()
    for scale, scans in by_weight(batch, settings).items():
        if scale == 0:
            skipped["scan.forgotten"] += len(scans)
            continue
        integrator.scale = scale
        used, beams, reasons = integrator.add(scans)
        scan_count, beam_count = scan_count + used, beam_count + beams
        skipped += reasons
    skipped["vote.underflow"] += int(integrator.lost[0])
    skipped["length.underflow"] += int(integrator.lost[1])
    integrator.lost[:] = 0
    return scan_count, beam_count, +skipped
