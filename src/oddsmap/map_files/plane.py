# SPDX-License-Identifier: Apache-2.0
"""Planes for files: from arrays, and the windows in which they are gone through."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from oddsmap.errors import InputError
from oddsmap.map_files.fields import Grid, PlanePart

__all__ = ["ArrayPlane", "windows"]

# A window of a million cells takes some 60 MB while it is worked out.
_ROWS, _COLUMNS = 256, 4096


class ArrayPlane:
    """A grid that is in memory, as a plane; see `oddsmap.map_files.fields.Plane`.

    Args:
        grid: its arrays.

    Raises:
        InputError: it has no cells, or no place that is finite.
    """

    has_counts = False

    def __init__(self, grid: Grid) -> None:
        ny, nx = grid.probability.shape
        if ny == 0 or nx == 0:
            raise InputError(f"the map has {ny} x {nx} cells, nothing to write")
        if not np.isfinite([*grid.origin, grid.yaw]).all():
            raise InputError(f"the origin {grid.origin}, yaw {grid.yaw} is not finite")
        self._grid = grid
        self.shape = (ny, nx)
        self.resolution, self.origin, self.yaw = grid.resolution, grid.origin, grid.yaw

    def part(self, rows: tuple[int, int], columns: tuple[int, int]) -> PlanePart:
        """The cells of some rows and columns, first and past the last; row 0 is the lowest y."""
        cut = slice(*rows), slice(*columns)
        return PlanePart(self._grid.probability[cut], self._grid.observed[cut], None, None)


def windows(
    shape: tuple[int, int], *, from_top: bool = False
) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Rows and columns, first and past the last, that cover a plane.

    Args:
        shape: its rows and columns.
        from_top: True: whole windows are counted from the last row down, as images are.
    """
    ny, nx = shape
    for at in range(0, ny, _ROWS):
        past = min(at + _ROWS, ny)
        rows = (ny - past, ny - at) if from_top else (at, past)
        for first in range(0, nx, _COLUMNS):
            yield rows, (first, min(first + _COLUMNS, nx))
