# SPDX-License-Identifier: Apache-2.0
"""2D segments into tiles: the step between the sensor model and the kernels.

Metres become cells, each scan gets a window of whole tiles, memory is made before a kernel needs
it; what the kernels cannot check is checked here.
"""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Sequence
from typing import Self

import numpy as np

from oddsmap.errors import InputError, MapTooLargeError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import TileStore
from oddsmap.integrate.path_lengths import LengthIntegrator, check_lengths
from oddsmap.integrate.to_cells import beam_shape, cells_near_return, to_cells
from oddsmap.kernels.trace.clip_beams import ScanCells
from oddsmap.kernels.trace.segments2d import COLUMNS
from oddsmap.kernels.units import ONE
from oddsmap.kernels.vote.rays2d import DONE, FULL, SLABS, Room, count_votes, mark_votes
from oddsmap.limits import MAX_COORDINATE
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.base import RaySensor
from oddsmap.sensors.segments import Segments

__all__ = ["Integrator2D"]

# A window of marks is at most this many cells, one byte each, so that it can be held; votes that
# add up take 16 bytes per cell. Larger scans are traced in blocks.
_MARK_WINDOW = 1 << 26
_COUNT_WINDOW = 1 << 22
# Beyond this many cells the blocks of one scan take seconds: a resolution chosen by mistake.
_MAX_SCAN_CELLS = 1 << 34


class Integrator2D:
    """Adds scans to tiles, with memory of its own to work in: one per thread.

    Args:
        evidence: the map whose resolution and kind of votes apply.
        sensor: the sensor model of the scans to come.
        tiles: where the votes go.
        lock: guards the tiles of path lengths, which all integrators of a map share.
    """

    def __init__(
        self,
        evidence: Evidence,
        sensor: RaySensor,
        tiles: TileStore,
        lock: threading.Lock | None = None,
    ) -> None:
        self.scale = ONE
        self.lost = np.zeros(2, np.int64)
        self.tiles = tiles
        self._resolution = evidence.resolution
        self._sensor = sensor
        self._every_beam = evidence.votes == "beam"
        self._shape = beam_shape(sensor.hit_shape, evidence.resolution)
        forgets = evidence.config.map.half_life is not None
        self._marks = not self._every_beam and sensor.whole_votes and not forgets
        self._mark_window = np.zeros(0, np.uint8)
        self._count_window = np.zeros((2, 0), np.int64)
        zone = cells_near_return(sensor.hit_shape, evidence.resolution, 2)
        self._cells = np.zeros((zone, 2), np.int64)
        self._left = np.zeros(zone)
        self._weights = np.zeros(zone, np.int64)
        self._room = Room(
            table=np.zeros((0, COLUMNS), np.int64),
            buffer=np.zeros((2, 0), np.int32),
            units=np.zeros((2, tiles.side**2), np.int64),
            box=np.zeros(4, np.int64),
            key=np.zeros(2, np.int64),
            band=np.zeros(0, np.uint8),
            found=np.zeros((0, 2), np.int64),
        )
        self._lengths: LengthIntegrator | None = None
        if evidence.lengths is not None:
            check_lengths(sensor)
            self._lengths = LengthIntegrator(
                evidence.lengths, lock or threading.Lock(), self._resolution, self.lost[1:]
            )

    @classmethod
    def for_threads(cls, evidence: Evidence, sensor: RaySensor, threads: int) -> Sequence[Self]:
        """One for each thread; scans are small and many, so that each has tiles of its own."""
        lock = threading.Lock()
        own = [evidence.tiles, *(evidence.new_tiles() for _ in range(threads - 1))]
        return [cls(evidence, sensor, tiles, lock) for tiles in own]

    def add(self, scans: Sequence[Measurement]) -> tuple[int, int, Counter[str]]:
        """Add a batch: returns scans used, beams used, and what was skipped by reason."""
        segments, skipped = self._sensor.segments(scans, MAX_COORDINATE * self._resolution)
        if len(segments.origins) and segments.origins.shape[1] != 2:
            raise InputError("3D scans cannot go into a 2D map")
        arrays = self._in_cells(segments)
        if len(arrays.tiles_lo):
            self._integrate(arrays)
            if self._lengths is not None:
                self._lengths.add(arrays, self.scale)
        return len(arrays.tiles_lo), len(arrays.hit), skipped

    def _in_cells(self, segments: Segments) -> ScanCells:
        return to_cells(segments, self._resolution, self.tiles.side, _MAX_SCAN_CELLS)

    def _integrate(self, scans: ScanCells) -> None:
        side = self.tiles.side
        limit = _MARK_WINDOW if self._marks else _COUNT_WINDOW
        block = max(1, (math.isqrt(limit) - 2) // side)
        self._make_room(scans, block)
        first, status = 0, FULL
        while status != DONE:
            if self._marks:
                first, status = mark_votes(
                    self.tiles.arrays, side, scans, first,
                    self._mark_window, block, self._room,
                )  # fmt: skip
            else:
                first, status = count_votes(
                    self.tiles.arrays, side, scans, first,
                    self._count_window, block, self._room,
                    self._every_beam, self._shape, self.scale,
                    self._cells, self._left, self._weights, self.lost,
                )  # fmt: skip
            if status == FULL:
                window = int((scans.tiles_hi[first] - scans.tiles_lo[first]).prod())
                self.tiles.reserve(window, window)
            elif status != DONE:
                raise MapTooLargeError(
                    "a cell's weight has passed 2^46 votes: the same evidence was added many times"
                )

    def _make_room(self, scans: ScanCells, block: int) -> None:
        widest = (scans.tiles_hi - scans.tiles_lo).max(axis=0)
        across, up = np.minimum(widest, block) * self.tiles.side + 2
        cells = int(across * up)
        if self._marks and len(self._mark_window) < cells:
            self._mark_window = np.zeros(cells, np.uint8)
        if not self._marks and self._count_window.shape[1] < cells:
            self._count_window = np.zeros((2, cells), np.int64)
        beams = int(np.diff(scans.offsets).max())
        if len(self._room.table) < beams:
            self._room = self._room._replace(table=np.zeros((beams, COLUMNS), np.int64))
        if len(self._room.band) < across:
            self._room = self._room._replace(
                band=np.zeros(across, np.uint8),
                found=np.zeros((across // self.tiles.side + 1, 2), np.int64),
            )
        slabs = SLABS + int((widest * self.tiles.side).max()) + 10
        if self._room.buffer.shape[1] < slabs:
            self._room = self._room._replace(buffer=np.zeros((2, slabs), np.int32))
