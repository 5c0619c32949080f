# SPDX-License-Identifier: Apache-2.0
"""2D segments into tiles: the step between the sensor model and the kernels.

Metres become cells, each scan gets a window of whole tiles, memory is made before a kernel needs
it; what the kernels cannot check is checked here.
"""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Self, TypeVar

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError, MapTooLargeError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import TileStore
from oddsmap.integrate.path_lengths import LengthIntegrator, check_lengths
from oddsmap.integrate.to_cells import beam_shape, cells_near_return, to_cells
from oddsmap.kernels.trace.clip_beams import ScanCells
from oddsmap.kernels.trace.segments2d import COLUMNS
from oddsmap.kernels.units import ONE
from oddsmap.kernels.vote.beam_counts2d import MOST_BEAMS, count_beams
from oddsmap.kernels.vote.marks2d import mark_votes
from oddsmap.kernels.vote.weights2d import count_votes
from oddsmap.kernels.vote.window2d import DONE, FULL, SLABS, Room
from oddsmap.limits import MAX_COORDINATE
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.base import RaySensor
from oddsmap.sensors.segments import Segments

__all__ = ["Integrator2D"]

# A window is at most this many cells, so that it can be held: marks take 1 byte per cell, counts
# of beams 4, weights 16. Larger scans are traced in blocks.
_MARK_WINDOW = 1 << 26
_COUNT_WINDOW = 1 << 24
_WEIGHT_WINDOW = 1 << 22
# Beyond this many cells the blocks of one scan take seconds: a resolution chosen by mistake.
_MAX_SCAN_CELLS = 1 << 34

_Cell = TypeVar("_Cell", bound=np.generic)


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
        forgets = evidence.config.map.forgets
        self._whole = sensor.whole_votes and not forgets
        self._mark_window = np.zeros((1, 0), np.uint8)
        self._count_window = np.zeros((2, 0), np.uint16)
        self._weight_window = np.zeros((2, 0), np.int64)
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
        most = int(np.diff(scans.offsets[scans.bundles]).max())
        if not self._whole or (self._every_beam and most > MOST_BEAMS):
            self._add_weights(scans)
        elif self._every_beam:
            self._count(scans)
        else:
            self._mark(scans)

    def _mark(self, scans: ScanCells) -> None:
        block = self._block(_MARK_WINDOW)
        self._mark_window = self._make_room(scans, block, self._mark_window)
        self._run(
            scans,
            lambda first: mark_votes(
                self.tiles.arrays, self.tiles.side, scans, first,
                self._mark_window[0], block, self._room,
            ),
            fractional=False,
        )  # fmt: skip

    def _count(self, scans: ScanCells) -> None:
        block = self._block(_COUNT_WINDOW)
        self._count_window = self._make_room(scans, block, self._count_window)
        self._run(
            scans,
            lambda first: count_beams(
                self.tiles.arrays, self.tiles.side, scans, first,
                self._count_window, block, self._room,
            ),
        )  # fmt: skip

    def _add_weights(self, scans: ScanCells) -> None:
        block = self._block(_WEIGHT_WINDOW)
        self._weight_window = self._make_room(scans, block, self._weight_window)
        self._run(
            scans,
            lambda first: count_votes(
                self.tiles.arrays, self.tiles.side, scans, first,
                self._weight_window, block, self._room,
                self._every_beam, self._shape, self.scale,
                self._cells, self._left, self._weights, self.lost,
            ),
        )  # fmt: skip

    def _run(
        self,
        scans: ScanCells,
        add_from: Callable[[int], tuple[int, int]],
        *,
        fractional: bool = True,
    ) -> None:
        """Add all scans; `add_from` adds from one on, while there is room for tiles.

        `fractional`: whether they may need wide rows, see `has_room`.
        """
        first, status = 0, FULL
        while status != DONE:
            first, status = add_from(first)
            if status == FULL:
                window = int((scans.tiles_hi[first] - scans.tiles_lo[first]).prod())
                wide = window if fractional or self.tiles.any_full else 0
                self.tiles.reserve(window, wide)
            elif status != DONE:
                raise MapTooLargeError(
                    "a cell's weight has passed 2^46 votes: the same evidence was added many times"
                )

    def _block(self, window: int) -> int:
        """How many tiles the side of a window of so many cells has."""
        return max(1, (math.isqrt(window) - 2) // self.tiles.side)

    def _make_room(
        self, scans: ScanCells, block: int, window: npt.NDArray[_Cell]
    ) -> npt.NDArray[_Cell]:
        """Make the room that a batch needs; returns the window, or a larger one."""
        widest = (scans.tiles_hi - scans.tiles_lo).max(axis=0)
        across, up = np.minimum(widest, block) * self.tiles.side + 2
        if window.shape[1] < across * up:
            window = np.zeros((len(window), int(across * up)), window.dtype)
        beams = int(np.diff(scans.offsets).max())
        if len(self._room.table) < beams:
            self._room = self._room._replace(table=np.zeros((beams, COLUMNS), np.int64))
        if len(self._room.band) < across or self._room.band.dtype != window.dtype:
            self._room = self._room._replace(
                band=np.zeros(across, window.dtype),
                found=np.zeros((across // self.tiles.side + 1, 2), np.int64),
            )
        slabs = SLABS + int((widest * self.tiles.side).max()) + 10
        if self._room.buffer.shape[1] < slabs:
            self._room = self._room._replace(buffer=np.zeros((2, slabs), np.int32))
        return window
