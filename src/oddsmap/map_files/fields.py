# SPDX-License-Identifier: Apache-2.0
"""What the writers of map files need of a map: arrays, whatever class holds them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray

__all__ = [
    "CellPoints",
    "Grid",
    "LeafPart",
    "Leaves",
    "OfLogOdds",
    "Plane",
    "PlanePart",
    "PointPart",
]


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


class PlanePart(NamedTuple):
    """Some cells of a plane, shape (ny, nx) each, row = y ascending."""

    probability: FloatArray
    """p(occupied); of no meaning where not observed."""
    observed: BoolArray
    """True where there was evidence."""
    hits: FloatArray | None
    """Weights of the hits [votes]; None where the map has no counts."""
    passes: FloatArray | None
    """Weights of the passes [votes]; None where the map has no counts."""


class Plane(Protocol):
    """A rectangle of cells that is asked for in parts, so that no file needs all of it at once."""

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""

    @property
    def origin(self) -> tuple[float, float]:
        """Lower left corner of its first cell in the map frame [m]."""

    @property
    def yaw(self) -> float:
        """Rotation of the grid about that corner [rad]."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""

    @property
    def has_counts(self) -> bool:
        """Whether its parts hold hits and passes."""

    def part(self, rows: tuple[int, int], columns: tuple[int, int]) -> PlanePart:
        """The cells of some rows and columns, first and past the last; row 0 is the lowest y."""


class PointPart(NamedTuple):
    """Some cells of a map as points."""

    centre: FloatArray
    """In the map frame [m], shape (n, 3)."""
    side: FloatArray
    """Of the cube [m], shape (n,)."""
    probability: FloatArray
    """p(occupied), shape (n,)."""
    hits: FloatArray | None
    """Weights of the hits [votes], shape (n,); None where the map has no counts."""
    passes: FloatArray | None
    """Weights of the passes [votes], shape (n,); None where the map has no counts."""


class CellPoints(Protocol):
    """The cells of a 3D map as points, some at a time."""

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""

    @property
    def has_counts(self) -> bool:
        """Whether its parts hold hits and passes."""

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of known cells: first index and past the last, shape (3,); None if empty."""

    def points(self, least: float) -> Iterator[PointPart]:
        """The cells of at least this probability."""


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
