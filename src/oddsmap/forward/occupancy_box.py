# SPDX-License-Identifier: Apache-2.0
"""A box of cells and what stands there, as a forward sensor model looks at it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.cell_index import one_cell
from oddsmap.errors import InputError
from oddsmap.short_repr import short_repr

__all__ = ["Window"]


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Occupancy of a box of cells; cells outside of it are free.

    Args:
        occupancy: 0 or 1, or the probability of each cell, shape (ny, nx) or (nz, ny, nx).
        resolution: side of a cell [m].
        lo: index of the first cell, shape (d,), x first; default: zeros.
        detection: chance that an occupied cell returns a beam, for each cell, of the shape of
            `occupancy`; default: the sensor model's.

    Raises:
        InputError: a value is not in [0, 1], the resolution is not positive, or shapes do not fit.
    """

    occupancy: FloatArray
    resolution: float
    lo: npt.NDArray[np.int64] | None = None
    detection: FloatArray | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        d = np.ndim(self.occupancy)
        if d not in (2, 3):
            raise InputError(
                f"a window has shape (ny, nx) or (nz, ny, nx), got {np.shape(self.occupancy)}"
            )
        if not 0.0 < self.resolution < math.inf:
            raise InputError(f"a window needs a positive resolution [m], got {self.resolution}")
        lo = np.zeros(d, np.int64) if self.lo is None else one_cell(self.lo, d)
        object.__setattr__(self, "lo", lo)
        for name in ("occupancy", "detection"):
            if getattr(self, name) is None:
                continue
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if value.shape != np.shape(self.occupancy):
                raise InputError(
                    f"detection has the shape of occupancy, {np.shape(self.occupancy)}, "
                    f"got {value.shape}"
                )
            if not ((value >= 0.0) & (value <= 1.0)).all():
                raise InputError(f"{name} lies between 0 and 1 in each cell of a window")
            object.__setattr__(self, name, value)

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the arrays: (ny, nx) or (nz, ny, nx)."""
        return self.occupancy.shape

    @property
    def first(self) -> npt.NDArray[np.int64]:
        """Index of the first cell, shape (d,), x first."""
        return np.zeros(self.occupancy.ndim, np.int64) if self.lo is None else self.lo

    def detection_or(self, default: float) -> FloatArray:
        """Chance of detection of each cell, flat; shape (1,) where one serves for all."""
        if self.detection is None:
            return np.array([default], np.float64)
        return self.detection.ravel()
