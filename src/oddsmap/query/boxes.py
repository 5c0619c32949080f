# SPDX-License-Identifier: Apache-2.0
"""Boxes of cells: first index and past the last, shape (d,) each, x first."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from oddsmap.array_types import IntArray

__all__ = ["Box"]


class Box(NamedTuple):
    """A box of cells."""

    lo: IntArray
    hi: IntArray

    @property
    def shape(self) -> tuple[int, ...]:
        """That of its array: (ny, nx) or (nz, ny, nx)."""
        return tuple(int(n) for n in (self.hi - self.lo)[::-1])

    @property
    def size(self) -> int:
        """How many cells."""
        return math.prod(self.shape)

    def equals(self, other: Box) -> bool:
        """Whether the two are one box."""
        return np.array_equal(self.lo, other.lo) and np.array_equal(self.hi, other.hi)

    def wider(self, cells: int) -> Box:
        """With so many more cells on every side."""
        return Box(self.lo - cells, self.hi + cells)

    def meet(self, other: Box) -> Box:
        """What the two have in common, of no cells where that is nothing."""
        lo = np.maximum(self.lo, other.lo)
        return Box(lo, np.maximum(lo, np.minimum(self.hi, other.hi)))

    def hull(self, other: Box) -> Box:
        """The smallest box that holds both; one without cells adds nothing."""
        if self.size == 0 or other.size == 0:
            return other if self.size == 0 else self
        return Box(np.minimum(self.lo, other.lo), np.maximum(self.hi, other.hi))

    def inside(self, other: Box) -> tuple[slice, ...]:
        """Where its cells are in the array of a box that holds them."""
        first, past = (self.lo - other.lo)[::-1], (self.hi - other.lo)[::-1]
        return tuple(slice(int(a), int(b)) for a, b in zip(first, past, strict=True))
