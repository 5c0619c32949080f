# SPDX-License-Identifier: Apache-2.0
"""What the writers of map files need of a map: arrays, whatever class holds them."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray

__all__ = ["Grid", "Leaves"]


class Grid(Protocol):
    """Probabilities of a rectangle of cells; see `oddsmap.ProbabilityMap`."""

    @property
    def probability(self) -> FloatArray:
        """p(occupied), shape (ny, nx), row = y ascending."""

    @property
    def observed(self) -> BoolArray:
        """True where there was evidence, same shape."""

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""

    @property
    def origin(self) -> tuple[float, float]:
        """Lower left corner of cell (0, 0) in the map frame [m]."""

    @property
    def yaw(self) -> float:
        """Rotation of the grid about that corner [rad]."""


class Leaves(Protocol):
    """Log odds of cubes of cells, in depth-first order; see `oddsmap.VoxelMap`."""

    @property
    def index(self) -> IntArray:
        """Lowest cell of each leaf, shape (n, 3), x first."""

    @property
    def log_odds(self) -> FloatArray:
        """Of each leaf, shape (n,)."""

    @property
    def level(self) -> npt.NDArray[np.uint8]:
        """A leaf has 2^level cells per side, shape (n,)."""

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""
