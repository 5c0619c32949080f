# SPDX-License-Identifier: Apache-2.0
"""Cell indices as callers give them: whole numbers, of the right shape, within reach.

A float would be cut off toward zero without a word: metres in place of indices, -0.5 as cell 0. So
floats are refused wherever cells are named, even those that happen to be whole.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError, MapTooLargeError
from oddsmap.limits import MAX_COORDINATE, memory_limit

__all__ = ["box_cells", "cell_box", "cell_indices", "check_room", "indices_in", "one_cell"]


def cell_indices(index: npt.ArrayLike, ndim: int) -> IntArray:
    """Cells as an array of shape (n, ndim), x first.

    Raises:
        InputError: another shape, no whole numbers, or cells beyond 2^46 from the map's origin.
    """
    cells = indices_in(index)
    if cells.size == 0 and cells.ndim <= 2:
        return np.empty((0, ndim), np.int64)
    if cells.ndim != 2 or cells.shape[1] != ndim:
        raise InputError(
            f"cells of a {ndim}D map need an index of shape (n, {ndim}), got {cells.shape}"
        )
    return cells


def one_cell(cell: npt.ArrayLike, ndim: int) -> IntArray:
    """One cell as an array of shape (ndim,), x first; errors as in `cell_indices`."""
    found = indices_in(cell)
    if found.shape != (ndim,):
        raise InputError(f"a cell of a {ndim}D map is {ndim} indices, x first, got {cell!r}")
    return found


def cell_box(lo: npt.ArrayLike, hi: npt.ArrayLike, ndim: int) -> tuple[IntArray, IntArray]:
    """A box of cells: first index and past the last, shape (ndim,), x first.

    Raises:
        InputError: as in `cell_indices`, or hi < lo.
    """
    first, last = indices_in(lo), indices_in(hi)
    if first.shape != (ndim,) or last.shape != first.shape or (last < first).any():
        raise InputError(f"a region needs lo <= hi of {ndim} indices, got {lo!r} and {hi!r}")
    return first, last


def box_cells(
    lo: npt.ArrayLike, hi: npt.ArrayLike, resolution: float, ndim: int
) -> tuple[IntArray, IntArray]:
    """The cells whose centres lie in a box of metres: first index and past the last, x first.

    A box whose sides lie between cells is met exactly, which the cells that it touches would not
    be: 0.3 / 0.1 is a little less than 3. Boxes side by side share no cell and leave none out.

    Args:
        lo: lowest corner [m], shape (ndim,), x first; a centre on it is inside.
        hi: highest corner [m]; a centre on it is outside.
        resolution: side of a cell [m].
        ndim: 2 or 3.

    Raises:
        InputError: not `ndim` finite numbers each, hi not above lo, or cells out of reach.
    """
    try:
        corners = [np.asarray(corner, np.float64) for corner in (lo, hi)]
    except (TypeError, ValueError):
        corners = []
    if [corner.shape for corner in corners] != 2 * [(ndim,)] or not np.isfinite(corners).all():
        raise InputError(f"a box needs {ndim} numbers [m] for each corner, got {lo!r} and {hi!r}")
    if not (corners[0] < corners[1]).all():
        raise InputError(f"a box needs its lowest corner before its highest, got {lo!r} and {hi!r}")
    first, past = np.ceil(np.array(corners) / resolution - 0.5)
    reach = 2 * MAX_COORDINATE
    if first.min() < -reach or past.max() > reach:
        raise InputError(
            f"the box {lo!r} to {hi!r} reaches farther than 2^46 cells from the map's origin: is "
            "it in metres?"
        )
    return first.astype(np.int64), past.astype(np.int64)


def check_room(lo: IntArray, hi: IntArray, bytes_per_cell: int) -> None:
    """Refuse a box whose cells would not fit in memory as an array.

    Raises:
        MapTooLargeError: with its size.
    """
    sides = [int(n) for n in hi - lo]
    needed, limit = math.prod(sides) * bytes_per_cell, memory_limit()
    if needed > limit:
        raise MapTooLargeError(
            f"a region of {' x '.join(map(str, sides))} cells needs {needed / 1e9:.3g} GB, more "
            f"than the {limit / 1e9:.1f} GB that may be used here: ask for a smaller one"
        )


def indices_in(index: npt.ArrayLike) -> IntArray:
    """Indices in an array of whatever shape, once it is clear that they are some.

    Raises:
        InputError: no whole numbers, or cells beyond 2^46 from the map's origin.
    """
    given = np.asarray(index)
    if given.size == 0:
        return given.astype(np.int64)
    if given.dtype.kind not in "iu":
        example = given.ravel()[0]
        raise InputError(
            f"cells are named by whole numbers, got {example} ({given.dtype}): cell_of(points) "
            "says which cells hold points [m], region_of(lo, hi) which lie in a box"
        )
    reach = 2 * int(MAX_COORDINATE)  # a sensor may stand that far away, and beams go on
    # As Python integers: the largest of them may not fit int64.
    lowest, highest = int(given.min()), int(given.max())
    if lowest < -reach or highest > reach:
        worst = highest if highest > reach else lowest
        raise InputError(
            f"cell index {worst} is farther than 2^46 cells from the map's origin, where "
            "coordinates have no precision left: is it in the unit that you mean?"
        )
    return given.astype(np.int64)
