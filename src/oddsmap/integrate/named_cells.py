# SPDX-License-Identifier: Apache-2.0
"""Votes of single cells into tiles: for sensors that name the cells themselves."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Sequence
from typing import Self

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import TileStore
from oddsmap.integrate.cell_window import CellWindow
from oddsmap.integrate.path_lengths import check_lengths
from oddsmap.kernels.units import ONE
from oddsmap.kernels.vote.cell_votes import gather_cells, run_of_scans
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.base import CellSensor
from oddsmap.sensors.cell_votes import CellVotes

__all__ = ["CellIntegrator"]

# Of the window of several scans: each that is touched takes 16 kB in 2D, 8 kB in 3D.
_MOST_BLOCKS = 1 << 12


class CellIntegrator:
    """Adds scans to tiles, with memory of its own to gather in: one per thread.

    Args:
        evidence: the map whose resolution and kind of votes apply.
        sensor: the sensor model of the scans to come.
        tiles: where the votes go.
        lock: guards the tiles; one for all integrators that share them.
    """

    def __init__(
        self, evidence: Evidence, sensor: CellSensor, tiles: TileStore, lock: threading.Lock
    ) -> None:
        self.tiles = tiles
        self._resolution = evidence.resolution
        self._sensor = sensor
        self._every_beam = evidence.votes == "beam"
        self.scale = ONE
        self.lost = np.zeros(2, np.int64)
        self._window = CellWindow(
            tiles, lock, every_beam=self._every_beam, resolution=self._resolution, lost=self.lost
        )

    @classmethod
    def for_threads(cls, evidence: Evidence, sensor: CellSensor, threads: int) -> Sequence[Self]:
        """One for each thread; all of them add to the map's tiles, by turns."""
        if evidence.lengths is not None:
            check_lengths(sensor)
        lock = threading.Lock()
        return [cls(evidence, sensor, evidence.tiles, lock) for _ in range(threads)]

    def add(self, scans: Sequence[Measurement]) -> tuple[int, int, Counter[str]]:
        """Add a batch: returns scans used, beams used, and what was skipped by reason."""
        parts, skipped = self._sensor.votes(scans, self._resolution)
        scan_count = beam_count = 0
        for votes in parts:
            if votes.index.shape[1] != self.tiles.ndim:
                raise InputError(
                    f"scans of {votes.index.shape[1]} dimensions cannot go into a map of "
                    f"{self.tiles.ndim}"
                )
            self._add(votes)
            scan_count += len(votes.offsets) - 1
            beam_count += votes.beams
        return scan_count, beam_count, skipped

    def _add(self, votes: CellVotes) -> None:
        # What every beam votes adds up, so that scans can be gathered together: single readings of
        # a sonar in a quarter of the time. Not where they weigh less, which rounds a scan's sum.
        joined = self._every_beam and self.scale == ONE
        lo, hi = np.empty((2, self.tiles.ndim), np.int64)
        scan = 0
        while scan < len(votes.offsets) - 1:
            first = scan
            scan = run_of_scans(
                votes.index, votes.offsets, first, self.tiles.side,
                _MOST_BLOCKS if joined else 0, lo, hi,
            )  # fmt: skip
            if hi[0] > lo[0]:
                self._integrate(votes, int(votes.offsets[first]), int(votes.offsets[scan]), lo, hi)

    def _integrate(
        self, votes: CellVotes, first: int, end: int, tiles_lo: IntArray, tiles_hi: IntArray
    ) -> None:
        shape = tiles_hi - tiles_lo
        first_cell, strides = self._window.open(tiles_lo, shape)
        window = self._window
        while first >= 0:
            first = gather_cells(
                votes.index, votes.hits, votes.passes, first, end, first_cell, self.tiles.side,
                strides, self._every_beam, window.table, window.used, window.weights,
            )  # fmt: skip
            if first >= 0:
                window.grow()
        window.apply(tiles_lo, shape, self.scale)
