# SPDX-License-Identifier: Apache-2.0
"""What the writers of map files need of a map: arrays, whatever class holds them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray

__all__ = ["Grid", "LeafPart", "Leaves", "OfLogOdds"]


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
    """Log odds of cubes of cells, in depth-first order of an octree; see `oddsmap.VoxelMap`."""

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""

    @property
    def base(self) -> IntArray:
        """The cell of code 0, shape (3,), x first."""

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of known cells: first index and past the last, shape (3,); None if empty."""

    def parts(self, function: OfLogOdds) -> Iterator[LeafPart]:
        """The leaves, some at a time: code, level, and a function of their log odds."""


class LeafPart(NamedTuple):
    """Some leaves of an octree, in order."""

    code: IntArray
    """Morton code of the lowest cell, counted from `Leaves.base`, shape (n,)."""
    level: npt.NDArray[np.uint8]
    """A leaf has 2^level cells per side, shape (n,)."""
    value: npt.NDArray[Any]
    """What the function gives, shape (n,)."""


OfLogOdds: TypeAlias = Callable[[FloatArray], npt.NDArray[Any]]
"""A function of log odds, element by element: equal ones have equal values, wherever they stand."""
