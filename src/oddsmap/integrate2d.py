# SPDX-License-Identifier: Apache-2.0
"""Segments of the plane into tiles: the step between the sensor model and the kernels.

Metres become cells, each scan gets a window of whole tiles, memory is made before a kernel needs
it; what the kernels cannot check is checked here.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError, MapTooLargeError
from oddsmap.evidence import EvidenceMap
from oddsmap.kernels.beams import cell_bounds
from oddsmap.kernels.integrate2d import DONE, FULL, ScanArrays, count_votes, mark_votes
from oddsmap.kernels.segments import COLUMNS, MAX_BORDERS
from oddsmap.poses import Pose2
from oddsmap.scan import Scan
from oddsmap.sensors.beam import BeamSensor, Segments
from oddsmap.tiles import TileStore, memory_limit

__all__ = ["Integrator2D", "compile_kernels"]

# A window of marks is at most this many cells, one byte each, so that it can be held; votes that
# add up take 16 bytes a cell. Larger scans are gone through in blocks.
_MARK_WINDOW = 1 << 26
_COUNT_WINDOW = 1 << 22
# Beyond this many cells the blocks of one scan take seconds: a resolution chosen by mistake.
_MAX_SCAN_CELLS = 1 << 34
# Coordinates beyond this many cells have no precision left within a cell.
_MAX_COORDINATE = float(1 << 45)


class Integrator2D:
    """Adds scans to tiles, with memory of its own to work in: one a thread.

    Args:
        evidence: the map whose resolution and kind of votes apply.
        sensor: the sensor model of the scans to come.
        tiles: where the votes go.
    """

    def __init__(self, evidence: EvidenceMap, sensor: BeamSensor, tiles: TileStore) -> None:
        self.tiles = tiles
        self._resolution = evidence.resolution
        self._sensor = sensor
        self._every_beam = evidence.votes == "beam"
        self._marks = not self._every_beam and self._sensor.hit_width == 0
        self._mark_window = np.zeros(0, np.uint8)
        self._count_window = np.zeros((2, 0), np.int64)
        self._table = np.zeros((0, COLUMNS), np.int64)
        self._buffer = np.zeros((2, 0), np.int32)

    def add(self, scans: Sequence[Scan]) -> tuple[int, int, Counter[str]]:
        """Add a batch: returns scans used, beams used, and what was skipped by reason."""
        segments, skipped = self._sensor.segments(scans)
        if len(segments.origins) and segments.origins.shape[1] != 2:
            raise InputError("scans of space (3D) cannot be mapped yet: only scans of the plane")
        arrays, too_far = self._in_cells(segments)
        if too_far:
            skipped["scan.pose_too_far"] += too_far
        if len(arrays.origins):
            self._integrate(arrays)
        return len(arrays.origins), len(arrays.hit), skipped

    def _in_cells(self, segments: Segments) -> tuple[ScanArrays, int]:
        segments, too_far = _without_far(segments, _MAX_COORDINATE * self._resolution)
        origins, offsets = segments.origins / self._resolution, segments.offsets
        lo, hi, way = origins.copy(), origins.copy(), np.zeros(len(origins))
        cell_bounds(segments.ends, offsets, self._resolution, lo, hi, way)
        if segments.tips is not segments.ends:
            cell_bounds(segments.tips, offsets, self._resolution, lo, hi, np.zeros_like(way))
        if np.isnan(way).any():
            raise InputError("a scan's directions are not numbers: each must be a unit vector")
        if len(origins):
            self._check_size(np.diff(offsets), way, lo, hi)
        side = self.tiles.side
        tiles_lo = np.floor(lo).astype(np.int64) // side
        tiles_hi = np.floor(hi).astype(np.int64) // side + 1
        scans = ScanArrays(
            origins, offsets, segments.ends, segments.tips, segments.hit, tiles_lo, tiles_hi
        )
        return scans, too_far

    def _check_size(
        self,
        beams: npt.NDArray[np.int64],
        way: npt.NDArray[np.float64],
        lo: npt.NDArray[np.float64],
        hi: npt.NDArray[np.float64],
    ) -> None:
        """Refuse a scan that memory could not hold, before any of it is done."""
        side = self.tiles.side
        extent = hi - lo + 2 * side
        window = extent.prod(axis=1)
        bytes_needed = 2.0 * np.minimum(way * side + 2 * beams * side**2, window)
        limit = memory_limit()
        too_large = (
            (bytes_needed > limit)
            | (window > _MAX_SCAN_CELLS)
            | (extent.max(axis=1) >= MAX_BORDERS)
        )
        if too_large.any():
            worst = int(np.argmax(np.where(too_large, window, 0.0)))
            metres = extent[worst] * self._resolution
            raise MapTooLargeError(
                f"one scan spans {metres[0]:.4g} x {metres[1]:.4g} m, {window[worst]:.1e} cells of "
                f"{self._resolution:g} m: it alone would take up to "
                f"{_gigabytes(bytes_needed[worst])} of memory (there are {_gigabytes(limit)}; a "
                f"scan may span {_MAX_SCAN_CELLS:.1e} cells); use a coarser resolution, or "
                "range_max where a reading is too long"
            )

    def _integrate(self, scans: ScanArrays) -> None:
        side = self.tiles.side
        limit = _MARK_WINDOW if self._marks else _COUNT_WINDOW
        block = max(1, (math.isqrt(limit) - 2) // side)
        self._make_room(scans, block)
        first, status = 0, FULL
        while status != DONE:
            if self._marks:
                first, status = mark_votes(
                    self.tiles.arrays, side, scans, first,
                    self._mark_window, block, self._table, self._buffer,
                )  # fmt: skip
            else:
                first, status = count_votes(
                    self.tiles.arrays, side, scans, first,
                    self._count_window, block, self._table, self._buffer,
                    self._every_beam, self._sensor.share_hit,
                )  # fmt: skip
            if status == FULL:
                window = int((scans.tiles_hi[first] - scans.tiles_lo[first]).prod())
                self.tiles.reserve(window, window)
            elif status != DONE:
                raise MapTooLargeError(
                    "a cell's weight has passed 2^46 votes: the same evidence was added many times"
                )

    def _make_room(self, scans: ScanArrays, block: int) -> None:
        widest = (scans.tiles_hi - scans.tiles_lo).max(axis=0)
        across, up = np.minimum(widest, block) * self.tiles.side + 2
        cells = int(across * up)
        if self._marks and len(self._mark_window) < cells:
            self._mark_window = np.zeros(cells, np.uint8)
        if not self._marks and self._count_window.shape[1] < cells:
            self._count_window = np.zeros((2, cells), np.int64)
        beams = int(np.diff(scans.offsets).max())
        if len(self._table) < beams:
            self._table = np.zeros((beams, COLUMNS), np.int64)
        borders = int((widest * self.tiles.side).max()) + 2
        if self._buffer.shape[1] < borders:
            self._buffer = np.zeros((2, borders), np.int32)


def _gigabytes(count: float) -> str:
    return f"{count / 1e9:.3g} GB"


def _without_far(segments: Segments, limit: float) -> tuple[Segments, int]:
    """Leave out scans whose pose is farther than the limit [m] from the map's origin."""
    near = np.abs(segments.origins).max(axis=1, initial=0.0) < limit
    if near.all():
        return segments, 0
    lengths = np.diff(segments.offsets)
    beams = np.repeat(near, lengths)
    ends = segments.ends[beams]
    kept = Segments(
        origins=segments.origins[near],
        offsets=np.concatenate([[0], np.cumsum(lengths[near])]),
        ends=ends,
        tips=ends if segments.tips is segments.ends else segments.tips[beams],
        hit=segments.hit[beams],
    )
    return kept, int(np.count_nonzero(~near))


def compile_kernels(votes: str, sensor: BeamSensor) -> float:
    """Compile what a map needs, or load it from the cache; returns the seconds that took."""
    started = time.perf_counter()
    _compile_once(votes == "scan" and sensor.hit_width == 0)
    return time.perf_counter() - started


@cache
def _compile_once(marks: bool) -> None:
    sensor = BeamSensor(hit_width=0.0 if marks else 1.0)
    toy = EvidenceMap(1.0, sensor=sensor)
    scan = Scan(Pose2(0.5, 0.5, 0.0), np.array([[1.0, 0.0]]), np.array([3.0]))
    Integrator2D(toy, sensor, toy.tiles).add([scan])
    toy.tiles.add(*next(toy.tiles.chunks()))
