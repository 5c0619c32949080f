# SPDX-License-Identifier: Apache-2.0
"""A map of any size in few pixels, a part of it after the other."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import HITS, ONE, PASSES
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.odds import sigmoid
from oddsmap.posterior.count_view import CountView
from oddsmap.posterior.tile_marks import WHOLE_VOTES

__all__ = ["LowZoom"]

MOST_PIXELS = 3800
"""As many as a picture has."""

# As many tiles at a time: a few megabytes.
_TILES = 1024
_UNSEEN = np.float32(-1.0)


class LowZoom:
    """Values of blocks of cells, as pictures have them, columns of a 3D map as one.

    A block has the largest probability of its cells from 0.5 on, else the mean of those known: an
    average alone would fade a wall of one cell away.

    Args:
        lo: the first cell, shape (2,) or (3,), x first.
        hi: past the last.
        pixels: blocks along each side, at most; 2 to 3800.

    Attributes:
        block: cells along the side of a block, 2^k.

    Raises:
        ConfigError: another number of pixels.
    """

    def __init__(self, lo: IntArray, hi: IntArray, pixels: int) -> None:
        if not 2 <= pixels <= MOST_PIXELS:
            raise ConfigError(f"pixels: 2 to {MOST_PIXELS} along each side, got {pixels}")
        lo, hi = lo[:2], hi[:2]
        self.block = 1
        while int((-(-hi // self.block) - lo // self.block).max()) > pixels:
            self.block *= 2
        self._first = lo // self.block
        self._width, self._height = (int(n) for n in -(-hi // self.block) - self._first)
        count = self._width * self._height
        self._largest = np.full(count, _UNSEEN)
        self._total, self._seen = np.zeros(count), np.zeros(count, np.int64)

    def add(self, view: CountView) -> None:
        """Add a part of the map; no cell is in two of them."""
        tiles = view.evidence.tiles
        if view.prior_map is not None:
            for index, p in view.parts(sigmoid):
                at = self._at(index[:, 0] // self.block, index[:, 1] // self.block)
                self._put(at, p.astype(np.float32), p, np.ones(len(p), np.int64))
            return

        def values(hits: FloatArray, passes: FloatArray) -> npt.NDArray[np.float32]:
            p = sigmoid(view.of_votes(hits, passes)).astype(np.float32)
            return np.where((hits > 0.0) | (passes > 0.0), p, _UNSEEN)

        table = values(*WHOLE_VOTES)
        for start in range(0, tiles.count, _TILES):
            slots = np.arange(start, min(start + _TILES, tiles.count))
            narrow = tiles.arrays.narrow[slots]
            value = table[(narrow[:, HITS].astype(np.uint16) << 8) | narrow[:, PASSES]]
            wide = tiles.arrays.wide_of[slots] >= 0
            if wide.any():
                units = tiles.units(slots[wide]) / ONE
                value[wide] = values(units[:, HITS], units[:, PASSES])
            self._add_tiles(tiles, slots, value)

    def _add_tiles(self, tiles: TileStore, slots: IntArray, value: npt.NDArray[np.float32]) -> None:
        """Add tiles of probabilities, `_UNSEEN` where nothing is known, shape (n, cells)."""
        side, d, n = tiles.side, tiles.ndim, len(slots)
        # Blocks within a tile, or tiles within a block; others' tiles fit neither: cell by cell.
        across = self.block if side % self.block == 0 else side if self.block % side == 0 else 1
        inside = side // across
        shape = (n, *(side,) * (d - 2), inside, across, inside, across)
        cells = value.reshape(shape)
        flat = tuple(axis for axis in range(1, len(shape)) if axis not in (d - 1, d + 1))
        seen = np.count_nonzero(cells >= 0.0, axis=flat)
        total = np.maximum(cells, 0.0).sum(axis=flat, dtype=np.float64)
        steps = np.arange(inside) * across
        x, y = ((tiles.coords[slots, axis, None] * side + steps) // self.block for axis in (0, 1))
        known = seen > 0
        at = self._at(
            np.broadcast_to(x[:, None, :], seen.shape)[known],
            np.broadcast_to(y[:, :, None], seen.shape)[known],
        )
        self._put(at, cells.max(axis=flat)[known], total[known], seen[known])

    def _at(self, x: IntArray, y: IntArray) -> IntArray:
        place: IntArray = (y - self._first[1]) * self._width + (x - self._first[0])
        return place

    def _put(
        self, at: IntArray, largest: npt.NDArray[np.float32], total: FloatArray, seen: IntArray
    ) -> None:
        np.maximum.at(self._largest, at, largest)
        np.add.at(self._total, at, total)
        np.add.at(self._seen, at, seen)

    def result(self, resolution: float, unseen: float) -> ProbabilityMap:
        """The blocks as cells of a map.

        Args:
            resolution: side of a cell [m], of those that were added.
            unseen: p(occupied) of blocks without any known cell.
        """
        mean = self._total / np.maximum(self._seen, 1)
        value = np.where(self._largest >= 0.5, self._largest, mean)
        observed = self._seen > 0
        side, shape = resolution * self.block, (self._height, self._width)
        return ProbabilityMap(
            np.where(observed, value, unseen).reshape(shape),
            observed.reshape(shape),
            side,
            (float(self._first[0]) * side, float(self._first[1]) * side),
        )
