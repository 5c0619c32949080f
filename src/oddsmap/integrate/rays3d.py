# SPDX-License-Identifier: Apache-2.0
"""3D scans into tiles: the step between the sensor model and the kernels."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Self

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError, MapTooLargeError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import TileStore
from oddsmap.integrate.path_lengths import LengthIntegrator, check_lengths
from oddsmap.integrate.to_cells import beam_shape, cells_near_return, to_cells
from oddsmap.kernels.trace.clip_beams import ScanCells
from oddsmap.kernels.trace.rays3d import COLUMNS, RAYS
from oddsmap.kernels.units import ONE
from oddsmap.kernels.vote.cell_votes import apply_counts
from oddsmap.kernels.vote.counts3d import count_scan
from oddsmap.kernels.vote.rays3d import (
    BIN_COUNT,
    SLABS,
    apply_marks,
    mark_hits,
    mark_passes,
    sort_rays,
)
from oddsmap.limits import MAX_COORDINATE, TOO_LONG, memory_for, memory_limit
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.base import RaySensor

__all__ = ["Integrator3D"]

# A cell's code (its block's place in the window and its place in the block) has 31 bits, which lets
# the kernels run twice as many lanes, or 53, which doubles hold, in a window of more cells.
_SHORT_CODES = (1 << 31) - 1
_LONG_CODES = (1 << 53) - 1
# A window's table has 4 bytes per block. Only what rays touch takes memory, but that may be all.
_MAX_TABLE_BLOCKS = min((1 << 31) - 1, memory_limit() // 8)
# Blocks that there is room for at first; it grows when a scan touches more.
_FIRST_BLOCKS = 1 << 10

# Below this many rays, to sort them by direction and skip what is marked takes longer than marking
# it again: 20,000 bundles of one ray take 0.5 s instead of 11.
_FEW_RAYS = 128


class Integrator3D:
    """Adds scans to tiles, with memory of its own to mark in: one per thread.

    Marking is most of the work and touches nothing shared. Tiles are added to under a lock, so
    that threads share one store and a second thread costs no second map.

    Args:
        evidence: the map whose resolution and kind of votes apply.
        sensor: the sensor model of the scans to come.
        tiles: where the votes go.
        lock: guards the tiles; one for all integrators that share them.
    """

    def __init__(
        self, evidence: Evidence, sensor: RaySensor, tiles: TileStore, lock: threading.Lock
    ) -> None:
        self.scale = ONE
        self.lost = np.zeros(2, np.int64)
        self.tiles = tiles
        self._lock = lock
        self._resolution = evidence.resolution
        self._sensor = sensor
        self._every_beam = evidence.votes == "beam"
        self._shape = beam_shape(sensor.hit_shape, evidence.resolution)
        forgets = evidence.config.map.half_life is not None
        self._marks_only = not self._every_beam and sensor.whole_votes and not forgets
        self._bits = tiles.side.bit_length() - 1
        if tiles.side != 1 << self._bits:
            raise InputError(f"3D tiles need a side that is a power of 2, got {tiles.side}")
        self._max_cells = min(_MAX_TABLE_BLOCKS << (3 * self._bits), _LONG_CODES)
        self._used = np.zeros(1, np.int64)
        self._marks = np.zeros(0, np.uint8)
        self._weights = np.zeros((2, 0), np.int64)
        self._table = np.zeros(0, np.int32)
        self._spans = np.empty((BIN_COUNT, 4))
        self._rays = np.empty(COLUMNS * RAYS)
        self._done = np.zeros(BIN_COUNT, np.int32)
        zone = cells_near_return(sensor.hit_shape, evidence.resolution, 3)
        self._zone = np.zeros((zone, 3), np.int64)
        self._zone_left = np.zeros(zone)
        self._zone_weights = np.zeros(zone, np.int64)
        self._lengths: LengthIntegrator | None = None
        if evidence.lengths is not None:
            check_lengths(sensor)
            self._lengths = LengthIntegrator(
                evidence.lengths, lock, self._resolution, self.lost[1:]
            )
        self._grow(_FIRST_BLOCKS)

    @classmethod
    def for_threads(cls, evidence: Evidence, sensor: RaySensor, threads: int) -> Sequence[Self]:
        """One for each thread; all of them add to the map's tiles, by turns."""
        lock = threading.Lock()
        return [cls(evidence, sensor, evidence.tiles, lock) for _ in range(threads)]

    def add(self, scans: Sequence[Measurement]) -> tuple[int, int, Counter[str]]:
        """Add a batch: returns scans used, beams used, and what was skipped by reason."""
        segments, skipped = self._sensor.segments(scans, MAX_COORDINATE * self._resolution)
        if len(segments.origins) and segments.origins.shape[1] != 3:
            raise InputError("2D scans cannot go into a 3D map")
        cells = to_cells(segments, self._resolution, self.tiles.side, self._max_cells)
        for scan in range(len(cells.tiles_lo)):
            self._integrate(cells, scan)
        if self._lengths is not None:
            self._lengths.add(cells, self.scale)
        return len(cells.tiles_lo), len(cells.hit), skipped

    def _integrate(self, scans: ScanCells, scan: int) -> None:
        tiles_lo = scans.tiles_lo[scan]
        shape = scans.tiles_hi[scan] - tiles_lo
        self._open_window(shape)
        if self._marks_only:
            self._mark(scans, scan, shape)
        else:
            self._count(scans, scan, shape)
        self._apply(tiles_lo, shape)

    def _open_window(self, shape: npt.NDArray[np.int64]) -> None:
        """Make a table for a window of so many blocks."""
        if len(self._table) < shape.prod():
            self._table = _new_table(int(shape.prod()))

    def _apply(self, tiles_lo: npt.NDArray[np.int64], shape: npt.NDArray[np.int64]) -> None:
        """Add what is marked or counted in a window to the tiles."""
        with self._lock:
            touched = int(self._used[0])
            self.tiles.reserve(
                touched, touched if self.tiles.any_full or not self._marks_only else 0
            )
            if self._marks_only:
                fits = apply_marks(
                    self.tiles.arrays,
                    tiles_lo,
                    int(shape[0]),
                    int(shape[1]),
                    self._table,
                    self._used,
                    self._marks,
                )
            else:
                fits = apply_counts(
                    self.tiles.arrays, tiles_lo, shape, self._every_beam, self.scale,
                    self._table, self._used, self._weights, self.lost,
                )  # fmt: skip
        if not fits:
            raise MapTooLargeError(
                "a cell's weight has passed 2^46 votes: the same evidence was added many times"
            )

    def _mark(self, scans: ScanCells, scan: int, shape: npt.NDArray[np.int64]) -> None:
        lo, strides = scans.tiles_lo[scan] << self._bits, _strides(shape)
        buffer = self._ray_buffer(shape, SLABS)
        bundles = range(scans.bundles[scan], scans.bundles[scan + 1])
        # All passes first: hits of one bundle go before the passes of another.
        for bundle in bundles:
            origin, ends = scans.origins[bundle], scans.ends[_part(scans, bundle)]
            bins = np.empty(len(ends), np.int32)
            skips = len(ends) >= _FEW_RAYS
            if skips:
                sort_rays(origin, ends, bins, self._spans)
                self._done[:] = 0
            first = 0
            while first >= 0:
                first = mark_passes(
                    origin, ends, lo, self._bits, strides, bins, self._spans, self._done,
                    self._rays, buffer, self._table, self._used, self._marks, skips, first,
                )  # fmt: skip
                if first >= 0:
                    self._grow(3 * buffer.shape[1] + len(ends))
        for bundle in bundles:
            part = _part(scans, bundle)
            while not mark_hits(
                scans.ends[part], scans.hit[part], lo, self._bits, strides,
                self._table, self._used, self._marks,
            ):  # fmt: skip
                self._grow(part.stop - part.start)

    def _count(self, scans: ScanCells, scan: int, shape: npt.NDArray[np.int64]) -> None:
        buffer = self._ray_buffer(shape, 0)
        for bundle in range(scans.bundles[scan], scans.bundles[scan + 1]):
            part = _part(scans, bundle)
            first = 0
            while first >= 0:
                first = count_scan(
                    scans.origins[bundle], scans.fades[part], scans.ends[part], scans.tips[part],
                    scans.hit[part],
                    scans.tiles_lo[scan] << self._bits, self._bits, _strides(shape),
                    self._every_beam, self._shape, self._rays, buffer,
                    self._table, self._used, self._weights,
                    self._zone, self._zone_left, self._zone_weights, first,
                )  # fmt: skip
                if first >= 0:
                    self._grow(3 * buffer.shape[1] + 2 * len(self._zone))

    def _ray_buffer(self, shape: npt.NDArray[np.int64], more: int) -> npt.NDArray[np.signedinteger]:
        """Room for the slabs of one ray through a window, and `more`."""
        return self._code_buffer(shape, (3, (int(shape.max()) << self._bits) + 10 + more))

    def _code_buffer(
        self, shape: npt.NDArray[np.int64], size: tuple[int, int]
    ) -> npt.NDArray[np.signedinteger]:
        """Room for codes of the cells of a window."""
        short = int(shape.prod()) << (3 * self._bits) <= _SHORT_CODES
        return np.empty(size, np.int32) if short else np.empty(size, np.int64)

    def _grow(self, more: int) -> None:
        before = len(self._used)
        blocks = 2 * before + more
        cells = blocks << (3 * self._bits)
        with _memory_for(blocks, cells * (1 if self._marks_only else 16)):
            # np.zeros takes address space; memory only where a block is touched.
            used = np.zeros(blocks, np.int64)
            used[:before] = self._used
            if self._marks_only:
                marks = np.zeros(cells, np.uint8)
                marks[: len(self._marks)] = self._marks
                self._marks = marks
            else:
                weights = np.zeros((2, cells), np.int64)
                weights[:, : self._weights.shape[1]] = self._weights
                self._weights = weights
        self._used = used


def _new_table(blocks: int) -> npt.NDArray[np.int32]:
    with _memory_for(blocks, 4 * blocks):
        return np.zeros(blocks, np.int32)


def _memory_for(blocks: int, size: int) -> AbstractContextManager[None]:
    return memory_for(f"the {blocks:.1e} blocks around one scan ({1e-9 * size:.1f} GB)", TOO_LONG)


def _part(scans: ScanCells, bundle: int) -> slice:
    """The segments of a bundle."""
    return slice(int(scans.offsets[bundle]), int(scans.offsets[bundle + 1]))


def _strides(shape: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    return np.array([1, shape[0], shape[0] * shape[1]], np.int64)
