# SPDX-License-Identifier: Apache-2.0
"""3D scans into tiles: the step between the sensor model and the kernels."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError, MapTooLargeError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import TileStore
from oddsmap.integrate.block_window import BlockWindow
from oddsmap.integrate.path_lengths import LengthIntegrator, check_lengths
from oddsmap.integrate.to_cells import beam_shape, cells_near_return, rays_of_scan, to_cells
from oddsmap.kernels.trace.clip_beams import ScanCells
from oddsmap.kernels.trace.rays3d import COLUMNS, RAYS
from oddsmap.kernels.units import ONE
from oddsmap.kernels.vote.beam_counts3d import apply_beams, count_rays
from oddsmap.kernels.vote.cell_votes import apply_counts
from oddsmap.kernels.vote.counts3d import count_scan
from oddsmap.kernels.vote.rays3d import (
    BIN_COLUMNS,
    BIN_COUNT,
    SLABS,
    apply_marks,
    mark_hits,
    mark_passes,
    sort_rays,
)
from oddsmap.limits import MAX_COORDINATE, memory_limit
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.base import RaySensor

__all__ = ["Integrator3D"]

# A cell's code (its block's place in the window and its place in the block) has 31 bits, which lets
# the kernels run twice as many lanes, or 53, which doubles hold, in a window of more cells.
_SHORT_CODES = (1 << 31) - 1
_LONG_CODES = (1 << 53) - 1
# A window's table has 4 bytes per block. Only what rays touch takes memory, but that may be all.
_MAX_TABLE_BLOCKS = min((1 << 31) - 1, memory_limit() // 8)
# Numbers per cell and their type: whether it was passed or hit, how many rays did, or by how much.
_PER_CELL = {"marks": (1, np.uint8), "counts": (2, np.uint16), "weights": (2, np.int64)}
# A cell counts as many rays as 16 bits hold; then counts go into the tiles.
MOST_BEAMS = (1 << 16) - 1

# Below this many rays, to sort them by direction and skip what is marked takes longer than marking
# it again.
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
        forgets = evidence.config.map.forgets
        self._gathers = _votes_gathered_as(sensor.whole_votes and not forgets, self._every_beam)
        self._bits = tiles.side.bit_length() - 1
        if tiles.side != 1 << self._bits:
            raise InputError(f"3D tiles need a side that is a power of 2, got {tiles.side}")
        self._max_cells = min(_MAX_TABLE_BLOCKS << (3 * self._bits), _LONG_CODES)
        channels, kind = _PER_CELL[self._gathers]
        self._window = BlockWindow(channels, kind, self._bits)
        self._spans = np.empty((BIN_COUNT, BIN_COLUMNS))
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
        self._window.open(int(shape.prod()))
        if self._gathers == "marks":
            self._mark(scans, scan, shape)
        elif self._gathers == "counts":
            self._count(scans, scan, shape)
        else:
            self._weigh(scans, scan, shape)
        self._apply(tiles_lo, shape)

    def _apply(self, tiles_lo: npt.NDArray[np.int64], shape: npt.NDArray[np.int64]) -> None:
        """Add what is gathered in the window to the tiles."""
        window, lost = self._window, self.lost
        across, up = int(shape[0]), int(shape[1])
        with self._lock:
            touched = int(window.used[0])
            marks = self._gathers == "marks"
            self.tiles.reserve(touched, 0 if marks and not self.tiles.any_full else touched)
            tiles = self.tiles.arrays
            if marks:
                fits = apply_marks(
                    tiles, tiles_lo, across, up, window.table, window.used, window.cells[0]
                )
            elif self._gathers == "counts":
                fits = apply_beams(
                    tiles, tiles_lo, across, up, window.table, window.used, window.cells
                )
            else:
                fits = apply_counts(
                    tiles, tiles_lo, shape, self._every_beam, self.scale,
                    window.table, window.used, window.cells, lost,
                )  # fmt: skip
        if not fits:
            raise MapTooLargeError(
                "a cell's weight has passed 2^46 votes: the same evidence was added many times"
            )

    def _mark(self, scans: ScanCells, scan: int, shape: npt.NDArray[np.int64]) -> None:
        lo, strides = scans.tiles_lo[scan] << self._bits, _strides(shape)
        window, buffer = self._window, self._ray_buffer(shape, SLABS)
        origins, whose, rays = rays_of_scan(scans, scan)
        ends, hit = scans.ends[rays], scans.hit[rays]
        bins = np.empty(len(ends), np.int32)
        skips = len(ends) >= _FEW_RAYS
        if skips:
            sort_rays(origins, whose, ends, bins, self._spans)
            self._done[:] = 0
        first = 0
        while first >= 0:
            first = mark_passes(
                origins, whose, ends, lo, self._bits, strides, bins, self._spans, self._done,
                self._rays, buffer, window.table, window.used, window.cells[0], skips, first,
            )  # fmt: skip
            if first >= 0:
                window.grow(3 * buffer.shape[1] + len(ends))
        while not mark_hits(
            ends, hit, lo, self._bits, strides, window.table, window.used, window.cells[0]
        ):
            window.grow(len(ends))

    def _count(self, scans: ScanCells, scan: int, shape: npt.NDArray[np.int64]) -> None:
        lo, strides = scans.tiles_lo[scan] << self._bits, _strides(shape)
        window, buffer = self._window, self._ray_buffer(shape, SLABS)
        origins, whose, rays = rays_of_scan(scans, scan)
        ends, hit = scans.ends[rays], scans.hit[rays]
        for begin in range(0, len(ends), MOST_BEAMS):
            if begin > 0:
                self._apply(scans.tiles_lo[scan], shape)
            some = slice(begin, begin + MOST_BEAMS)
            first = 0
            while first >= 0:
                first = count_rays(
                    origins, whose[some], ends[some], hit[some],
                    lo, self._bits, strides, self._rays, buffer,
                    window.table, window.used, window.cells, first,
                )  # fmt: skip
                if first >= 0:
                    window.grow(3 * buffer.shape[1] + RAYS)

    def _weigh(self, scans: ScanCells, scan: int, shape: npt.NDArray[np.int64]) -> None:
        window, buffer = self._window, self._ray_buffer(shape, 0)
        origins, whose, rays = rays_of_scan(scans, scan)
        first = 0
        while first >= 0:
            first = count_scan(
                origins, whose, scans.fades[rays], scans.ends[rays], scans.tips[rays],
                scans.hit[rays],
                scans.tiles_lo[scan] << self._bits, self._bits, _strides(shape),
                self._every_beam, self._shape, self._rays, buffer,
                window.table, window.used, window.cells,
                self._zone, self._zone_left, self._zone_weights, first,
            )  # fmt: skip
            if first >= 0:
                window.grow(3 * buffer.shape[1] + 2 * len(self._zone))

    def _ray_buffer(self, shape: npt.NDArray[np.int64], more: int) -> npt.NDArray[np.signedinteger]:
        """Room for the slabs of one ray through a window, and `more`."""
        return self._code_buffer(shape, (3, (int(shape.max()) << self._bits) + 10 + more))

    def _code_buffer(
        self, shape: npt.NDArray[np.int64], size: tuple[int, int]
    ) -> npt.NDArray[np.signedinteger]:
        """Room for codes of the cells of a window."""
        short = int(shape.prod()) << (3 * self._bits) <= _SHORT_CODES
        return np.empty(size, np.int32) if short else np.empty(size, np.int64)


def _votes_gathered_as(whole: bool, every_beam: bool) -> str:
    """How the votes of a scan are gathered: see `_PER_CELL`."""
    if not whole:
        return "weights"
    return "counts" if every_beam else "marks"


def _strides(shape: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    return np.array([1, shape[0], shape[0] * shape[1]], np.int64)
