# SPDX-License-Identifier: Apache-2.0
"""The columns of a 3D map, numbered: x fastest."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.errors import MapTooLargeError

__all__ = ["Columns"]

_MAX_COLUMNS = 1 << 31


class Columns:
    """The columns of a box of cells.

    Args:
        lo: its first cell, shape (3,), x first.
        hi: past its last one.
        resolution: side of a cell [m].

    Raises:
        MapTooLargeError: more than 2^31 columns.
    """

    def __init__(self, lo: IntArray, hi: IntArray, resolution: float) -> None:
        self._lo = lo
        nx, ny, self._layers = (int(n) for n in hi - lo)
        if nx * ny > _MAX_COLUMNS:
            raise MapTooLargeError(f"the 2D map would have {nx} x {ny} cells; crop the map first")
        self.shape, self.count = (ny, nx), nx * ny
        self.origin = (float(lo[0]) * resolution, float(lo[1]) * resolution)
        """Lower left corner of column 0 [m]."""

    def number(self, index: IntArray) -> IntArray:
        """The columns of cells, shape (n,); index has shape (n, 3), x first."""
        x, y = index[:, 0] - self._lo[0], index[:, 1] - self._lo[1]
        return np.asarray(y * self.shape[1] + x)

    def place(self, number: IntArray) -> IntArray:
        """Indices of columns along x and y, shape (n, 2)."""
        return np.stack([number % self.shape[1], number // self.shape[1]], axis=1) + self._lo[:2]

    def nowhere(self) -> npt.NDArray[np.unsignedinteger]:
        """For each column a layer above all cells, for `lower`; in few bytes."""
        return np.full(self.count, self._layers, np.min_scalar_type(self._layers))

    def lower(self, lowest: npt.NDArray[np.unsignedinteger], index: IntArray) -> None:
        """Bring the layers of columns down to those of cells; index has shape (n, 3), x first."""
        layer = (index[:, 2] - self._lo[2]).astype(lowest.dtype)
        np.minimum.at(lowest, self.number(index), layer)

    def lowest_cells(self, lowest: npt.NDArray[np.unsignedinteger]) -> IntArray:
        """The lowest cell of each column that has one, shape (m, 3), x first."""
        number = np.flatnonzero(lowest < self._layers)
        return np.column_stack([self.place(number), lowest[number].astype(np.int64) + self._lo[2]])
