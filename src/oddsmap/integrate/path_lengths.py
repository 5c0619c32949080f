# SPDX-License-Identifier: Apache-2.0
"""The length of beams inside cells: the third channel of evidence, kept where it is asked for."""

from __future__ import annotations

import threading
from typing import cast

import numpy as np
import numpy.typing as npt

from oddsmap.errors import ConfigError
from oddsmap.evidence.tiles import TileStore
from oddsmap.integrate.cell_window import CellWindow
from oddsmap.integrate.to_cells import rays_of_scan
from oddsmap.kernels.trace.clip_beams import ScanCells
from oddsmap.kernels.vote.path_lengths import gather_lengths
from oddsmap.sensors.base import RaySensor
from oddsmap.sensors.registry import Sensor

__all__ = ["LengthIntegrator", "check_lengths"]


def check_lengths(sensor: Sensor) -> None:
    """Refuse a sensor whose beams have no length inside cells.

    Raises:
        ConfigError: a sensor without narrow beams, or one whose hits are wide.
    """
    if sensor.evidence_from != "rays":
        raise ConfigError(
            f"map.path_lengths is for narrow beams, the sensor is of kind {sensor.kind}"
        )
    shape = cast(RaySensor, sensor).hit_shape
    if shape.half_width > 0.0:
        width = 0.0 if shape.sigma > 0.0 else 2.0 * shape.half_width
        raise ConfigError(
            "map.path_lengths counts up to the return, where the hit is: it needs "
            f"sensor.hit_width = 0 and sigma = 0, got {width:g} and {shape.sigma:g}"
        )


class LengthIntegrator:
    """Adds the lengths of beams to their tiles: one per thread.

    Args:
        tiles: where the lengths go, in place of passes.
        lock: guards the tiles.
        resolution: side of a cell [m], for messages.
        lost: see `CellWindow`.
    """

    def __init__(
        self,
        tiles: TileStore,
        lock: threading.Lock,
        resolution: float,
        lost: npt.NDArray[np.int64],
    ) -> None:
        self._window = CellWindow(tiles, lock, every_beam=True, resolution=resolution, lost=lost)
        self._cells = np.zeros((0, tiles.ndim), np.int64)
        self._left = np.zeros(0)
        self._units = np.zeros(0, np.int64)
        self._nothing = np.zeros(0, np.int64)

    def add(self, scans: ScanCells, scale: int) -> None:
        """Add a batch of scans that weigh scale / 65536 each."""
        window = self._window
        for scan, tiles_lo in enumerate(scans.tiles_lo):
            shape = scans.tiles_hi[scan] - tiles_lo
            lo, strides = window.open(tiles_lo, shape)
            origins, whose, rays = rays_of_scan(scans, scan)
            ends = scans.ends[rays]
            self._make_room(origins[whose], ends)
            first = 0
            while first >= 0:
                first = gather_lengths(
                    origins, whose, ends, first, lo, window.tiles.side, strides,
                    self._cells, self._left, self._units, self._nothing,
                    window.table, window.used, window.weights,
                )  # fmt: skip
                if first >= 0:
                    window.grow()
            window.apply(tiles_lo, shape, scale)

    def _make_room(self, starts: npt.NDArray[np.float64], ends: npt.NDArray[np.float64]) -> None:
        borders = np.abs(np.floor(ends) - np.floor(starts)).sum(axis=1).max(initial=0.0)
        size = int(borders) + 2
        if len(self._left) < size:
            self._cells = np.zeros((size, starts.shape[1]), np.int64)
            self._left = np.zeros(size)
            self._units = np.zeros(size, np.int64)
            self._nothing = np.zeros(size, np.int64)
