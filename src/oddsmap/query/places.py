# SPDX-License-Identifier: Apache-2.0
"""Points in metres and the cells that hold them.

One rule for every question: a point has finite coordinates, within 2^46 cells of the map's origin.
Others are refused, all of them together, and nothing is answered: a NaN is no place, and farther
away a coordinate does not tell cells apart any more. Every other point has an answer, however far
from what the map has seen.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.cell_index import box_cells, cell_indices
from oddsmap.errors import InputError
from oddsmap.limits import MAX_COORDINATE

__all__ = ["CellGrid", "Framed", "Placed", "check_places", "points_in"]


class CellGrid(Protocol):
    """A field of cells."""

    @property
    def ndim(self) -> int:
        """2 or 3."""

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""


class Placed:
    """Cells in the map frame: cell i covers [i * resolution, (i + 1) * resolution) on each axis."""

    __slots__ = ()

    def cell_of(self: CellGrid, points: npt.ArrayLike) -> IntArray:
        """The cells that hold points, wherever they lie.

        Args:
            points: in the map frame [m], shape (n, d), x first.

        Returns:
            Cell indices, shape (n, d): floor(point / resolution).

        Raises:
            InputError: another shape, or coordinates that are not finite or farther than 2^46 cells
                from the map's origin.
        """
        place = points_in(points, self.ndim) / self.resolution
        return check_places(place)

    def centre_of(self: CellGrid, cells: npt.ArrayLike) -> FloatArray:
        """The centres of cells.

        Args:
            cells: cell indices, shape (n, d), x first.

        Returns:
            Points in the map frame [m], shape (n, d).

        Raises:
            InputError: another shape, no whole numbers, or cells beyond 2^46 from the map's origin.
        """
        return (cell_indices(cells, self.ndim).astype(np.float64) + 0.5) * self.resolution

    def region_of(
        self: CellGrid, lo: npt.ArrayLike, hi: npt.ArrayLike
    ) -> tuple[IntArray, IntArray]:
        """The region of cells of a box of metres, for whatever takes one.

        A cell belongs to it if its centre lies in the box: boxes side by side share no cell and
        leave none out.

            view.probability(view.region_of((0.0, 0.0), (40.0, 25.0)))

        Args:
            lo: lowest corner [m], shape (d,), x first; a centre on it is inside.
            hi: highest corner [m], shape (d,); a centre on it is outside.

        Returns:
            First cell and past the last, shape (d,) each, x first.

        Raises:
            InputError: they are not d finite numbers each, or hi is not above lo.
        """
        return box_cells(lo, hi, self.resolution, self.ndim)


class _Framed(CellGrid, Protocol):
    @property
    def map_from_cells(self) -> tuple[FloatArray, FloatArray] | None: ...


class Framed(Placed):
    """Cells that may count from another corner than the map frame's, along other axes.

    `map_from_cells` says from where: rotation, shape (d, d), and translation [m], shape (d,); None:
    from the map frame.
    """

    __slots__ = ()

    def cell_of(self: _Framed, points: npt.ArrayLike) -> IntArray:
        """The cells that hold points: see `Placed.cell_of`."""
        place = points_in(points, self.ndim)
        if self.map_from_cells is not None:
            turn, corner = self.map_from_cells
            place = (place - corner) @ turn  # rows from the right: by the inverse
        return check_places(place / self.resolution)

    def centre_of(self: _Framed, cells: npt.ArrayLike) -> FloatArray:
        """The centres of cells: see `Placed.centre_of`."""
        centre = (cell_indices(cells, self.ndim).astype(np.float64) + 0.5) * self.resolution
        if self.map_from_cells is not None:
            turn, corner = self.map_from_cells
            centre = centre @ turn.T + corner
        return centre


def points_in(points: npt.ArrayLike, ndim: int, what: str = "points") -> FloatArray:
    """Points or directions as an array of shape (n, ndim), x first.

    Raises:
        InputError: another shape, or no real numbers.
    """
    try:
        given = np.asarray(points)
    except ValueError:  # rows of different lengths
        given = np.asarray(None)
    if given.dtype.kind not in "iuf":
        raise InputError(f"{what} are real numbers, shape (n, {ndim}), got {type(points).__name__}")
    if given.size == 0 and given.ndim <= 2:
        return np.empty((0, ndim))
    if given.ndim != 2 or given.shape[1] != ndim:
        one = " (one alone is [point])" if given.shape == (ndim,) else ""
        raise InputError(
            f"{what} of a {ndim}D map have shape (n, {ndim}), x first, got {given.shape}{one}"
        )
    return given.astype(np.float64)


def check_places(place: FloatArray) -> IntArray:
    """Cells of places given in cells, once it is clear that they have some.

    Raises:
        InputError: some have none.
    """
    # Not (... > ...): so that NaN counts, too.
    wrong = ~(np.abs(place) <= 2.0 * MAX_COORDINATE).all(axis=1)
    if wrong.any():
        first = int(np.argmax(wrong))
        raise InputError(
            f"{np.count_nonzero(wrong)} of {len(place)} points have no cell, the first is point "
            f"{first}, {place[first].tolist()} in cells: coordinates must be finite, within 2^46 "
            "cells of the map's origin; leave such points out"
        )
    return np.floor(place).astype(np.int64)
