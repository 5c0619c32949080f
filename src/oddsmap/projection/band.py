# SPDX-License-Identifier: Apache-2.0
"""Which cells of each column lie in a band of heights, in whole numbers."""

from __future__ import annotations

import math

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray, IntArray

__all__ = ["FAR", "Band"]

FAR = 1 << 30
"""An end so many cells beyond the map, or more, is none."""


class Band:
    """The cells of columns whose centres lie in a band: z_min <= z < z_max.

    Layers count from the lowest of the map, and go on below and above it: a band has the same
    cells however high the map is. A column's are those of its layers from `first` on and before
    `past`; beyond an end that the band has not, those of the map.

    Args:
        z_min: lower end [m]; -inf for none.
        z_max: upper end [m]; inf for none.
        resolution: side of a cell [m].
        layers: the map's lowest layer of cells, and past its highest.
        heights: of the ground in each column [m], shape (n,), NaN where a column has no cells;
            None: 0 everywhere.
    """

    def __init__(
        self,
        z_min: float,
        z_max: float,
        resolution: float,
        layers: tuple[int, int],
        heights: FloatArray | None,
    ) -> None:
        self._lowest, self.resolution = layers[0], resolution
        self.layers = layers[1] - layers[0]
        """Of the map."""
        ground = np.zeros(1) if heights is None else heights
        self.has_low = z_min > (layers[0] - FAR) * resolution
        """Whether the band has a lower end."""
        self.has_high = z_max < (layers[1] + FAR) * resolution
        """Whether it has an upper end."""
        self.first = self._first_from(z_min if self.has_low else -math.inf, ground)
        """Shape (n,), or (1,) where all columns are alike."""
        self.past = self._first_from(z_max if self.has_high else math.inf, ground)
        self.past = np.maximum(self.past, self.first)
        self.past[np.isnan(ground)] = self.first[np.isnan(ground)] = 0

    def layer_of(self, index: IntArray) -> IntArray:
        """The layers of cells, shape (n,); index has shape (n, 3), x first."""
        return np.asarray(index[:, 2] - self._lowest)

    def of(self, values: IntArray, column: IntArray) -> IntArray:
        """What an array such as `first` has for columns."""
        return np.asarray(values[column] if len(values) > 1 else values)

    def holds(self, layer: IntArray, column: IntArray) -> BoolArray:
        """Which cells are in the band."""
        first, past = self.of(self.first, column), self.of(self.past, column)
        return np.asarray((layer >= first) & (layer < past))

    def heights(self, first: IntArray, past: IntArray) -> tuple[int, int]:
        """Indices of cells along z that such layers lie between: the first, and past the last."""
        first, past = np.maximum(first, 0), np.minimum(past, self.layers)
        some = past > first
        if not some.any():
            return self._lowest, self._lowest
        return self._lowest + int(first[some].min()), self._lowest + int(past[some].max())

    def _first_from(self, limit: float, ground: FloatArray) -> IntArray:
        """The first layer whose centre is that high above the ground [m], or higher."""
        if math.isinf(limit):
            return np.full(len(ground), 0 if limit < 0 else self.layers, np.int64)
        with np.errstate(invalid="ignore", over="ignore"):
            guess = np.ceil((limit + ground) / self.resolution - 0.5) - self._lowest
        low, high = -FAR, self.layers + FAR
        layer = np.clip(np.where(np.isnan(guess), high, guess), low, high).astype(np.int64)
        while True:
            # A guess is off by what was rounded: what decides is the height of the centre.
            down = (layer > low) & self._is_from(layer - 1, limit, ground)
            up = (layer < high) & ~self._is_from(layer, limit, ground)
            if not (down.any() or up.any()):
                return layer
            layer += up.astype(np.int64) - (down & ~up)

    def _is_from(self, layer: IntArray, limit: float, ground: FloatArray) -> BoolArray:
        centre = (layer + self._lowest + 0.5) * self.resolution
        return np.asarray(centre - ground >= limit)
