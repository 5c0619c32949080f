# SPDX-License-Identifier: Apache-2.0
"""Memory in which one scan's weights of single cells are gathered before they go into tiles."""

from __future__ import annotations

import threading

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import MapTooLargeError
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.vote.cell_votes import apply_counts
from oddsmap.limits import TOO_LONG, memory_limit

__all__ = ["CellWindow"]


class CellWindow:
    """A window of blocks, one per tile, with memory where a block is touched.

    Args:
        tiles: where the weights go.
        lock: guards the tiles.
        every_beam: True: weights add up; False: the largest counts, and hits go before passes.
        resolution: side of a cell [m], for messages.
        lost: lost[0] counts weights that became 0, see `scale_units`.
    """

    def __init__(
        self,
        tiles: TileStore,
        lock: threading.Lock,
        *,
        every_beam: bool,
        resolution: float,
        lost: IntArray,
    ) -> None:
        self.tiles = tiles
        self.every_beam = every_beam
        self.table = np.zeros(0, np.int32)
        self.used = np.zeros(1, np.int64)
        self.weights = np.zeros((2, tiles.side**tiles.ndim), np.int64)
        self._lock = lock
        self._resolution = resolution
        self._lost = lost

    def open(self, tiles_lo: IntArray, shape: IntArray) -> tuple[IntArray, IntArray]:
        """Make room for a window.

        Args:
            tiles_lo: its first tile, shape (d,).
            shape: how many tiles it has along each axis, shape (d,).

        Returns:
            Its first cell, and the strides of its blocks, shape (d,) each: see `gather_cells`.

        Raises:
            MapTooLargeError: memory would not hold the window's table.
        """
        blocks = float(shape.astype(np.float64).prod())
        if 4 * blocks > memory_limit():
            raise MapTooLargeError(
                f"one scan spans {blocks * float(self.tiles.side) ** len(shape):.1e} cells of "
                f"{self._resolution:g} m: {TOO_LONG}"
            )
        if len(self.table) < blocks:
            self.table = np.zeros(int(blocks), np.int32)
        strides = np.concatenate([[1], np.cumprod(shape[:-1])]).astype(np.int64)
        return tiles_lo * self.tiles.side, strides

    def grow(self) -> None:
        """Make room for twice as many blocks."""
        used = np.zeros(2 * len(self.used), np.int64)
        used[: len(self.used)] = self.used
        weights = np.zeros((2, 2 * self.weights.shape[1]), np.int64)
        weights[:, : self.weights.shape[1]] = self.weights
        self.used, self.weights = used, weights

    def apply(self, tiles_lo: IntArray, shape: IntArray, scale: int) -> None:
        """Add what was gathered to the tiles, and empty the window.

        Args:
            tiles_lo: as for `open`.
            shape: as for `open`.
            scale: what the scan's votes weigh [1/65536].

        Raises:
            MapTooLargeError: a cell passed 2^46 votes.
        """
        with self._lock:
            touched = int(self.used[0])
            self.tiles.reserve(touched, touched)
            fits = apply_counts(
                self.tiles.arrays, tiles_lo, shape, self.every_beam, scale,
                self.table, self.used, self.weights, self._lost,
            )  # fmt: skip
        if not fits:
            raise MapTooLargeError(
                "a cell's weight has passed 2^46 votes: the same evidence was added many times"
            )
