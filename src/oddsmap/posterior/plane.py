# SPDX-License-Identifier: Apache-2.0
"""A 2D view as a plane for files, which take it in parts."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from oddsmap.array_types import IntArray, Region
from oddsmap.errors import InputError
from oddsmap.map_files.fields import PlanePart

__all__ = ["BeliefPlane"]


class _View(Protocol):
    """What of `oddsmap.posterior.belief.Belief` a plane needs."""

    @property
    def ndim(self) -> int: ...
    @property
    def resolution(self) -> float: ...
    @property
    def has_counts(self) -> bool: ...
    def bounds(self) -> tuple[IntArray, IntArray] | None: ...
    def part(self, region: Region) -> PlanePart: ...


class BeliefPlane:
    """The box of known cells of a 2D view; see `oddsmap.map_files.fields.Plane`.

    Args:
        view: the view.

    Raises:
        InputError: a 3D map, or one without a known cell.
    """

    yaw = 0.0

    def __init__(self, view: _View) -> None:
        if view.ndim != 2:
            raise InputError(
                "a grid of cells needs a 2D map, this one is 3D: oddsmap.project makes one of a "
                "band of heights (--z-min, --z-max)"
            )
        box = view.bounds()
        if box is None:
            raise InputError("the map has no cells, nothing to write")
        self._view, (self._first, past) = view, box
        nx, ny = (int(n) for n in past - self._first)
        self.shape = (ny, nx)
        self.resolution, self.has_counts = view.resolution, view.has_counts
        x, y = (float(n) * view.resolution for n in self._first)
        self.origin = (x, y)

    def part(self, rows: tuple[int, int], columns: tuple[int, int]) -> PlanePart:
        """The cells of some rows and columns, first and past the last; row 0 is the lowest y."""
        lo, hi = np.array([columns, rows]).T + self._first
        return self._view.part((lo, hi))
