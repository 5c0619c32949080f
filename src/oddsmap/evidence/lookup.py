# SPDX-License-Identifier: Apache-2.0
"""Single cells: their place in another grid, and their votes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.cell_index import cell_indices
from oddsmap.evidence.evidence import Evidence
from oddsmap.kernels.units import FRACTION_BITS

__all__ = ["floor_cells", "same_places", "units_at"]


# A cell of 0.1 m has its centre on a border of cells of 0.05 m: rounding must not decide there.
_ON_BORDER = 1e-6


def floor_cells(place: FloatArray) -> IntArray:
    """Cells that hold places given in cells; within 1e-6 of a border, the cell above it."""
    border = np.rint(place)
    near = np.abs(place - border) <= _ON_BORDER
    return np.where(near, border, np.floor(place)).astype(np.int64)


def same_places(index: IntArray, resolution: float, other: float) -> IntArray:
    """Cells of another grid of the same frame that hold the centres of cells.

    Args:
        index: cells, shape (n, d).
        resolution: their side [m].
        other: side of the other grid's cells [m]; if it is the same, so are the cells.
    """
    if other == resolution:
        return index
    centre = (index.astype(np.float64) + 0.5) * resolution
    return floor_cells(centre / other)


def units_at(evidence: Evidence, index: npt.ArrayLike) -> tuple[IntArray, IntArray]:
    """Hits and passes of single cells, wherever they lie.

    Args:
        evidence: the map.
        index: cells, shape (n, d), x first.

    Returns:
        hits and passes, shape (n,), in units of 1/65536 vote; 0 where there is no evidence.

    Raises:
        InputError: an index of another shape, or no whole numbers.
    """
    d = evidence.ndim
    cells = cell_indices(index, d)
    store, side = evidence.tiles, evidence.tiles.side
    units = np.zeros((len(cells), 2), np.int64)
    slot = _find_rows(store.coords, cells // side)
    found = np.flatnonzero(slot >= 0)
    slot = slot[found]
    within = np.ravel_multi_index(tuple((cells[found] % side).T[::-1]), (side,) * d)
    votes = store.arrays.narrow[slot, :, within].astype(np.int64) << FRACTION_BITS
    row = store.arrays.wide_of[slot]
    votes[row >= 0] += store.arrays.wide[row[row >= 0], :, within[row >= 0]]
    units[found] = votes
    return units[:, 0], units[:, 1]


def _find_rows(rows: IntArray, wanted: IntArray) -> IntArray:
    """Where each row of `wanted` stands in `rows` (all different), -1 where it does not."""
    if len(rows) == 0:
        return np.full(len(wanted), -1, np.int64)
    found = np.ones(len(wanted), np.bool_)
    have, want = np.zeros(len(rows), np.int64), np.zeros(len(wanted), np.int64)
    # One number for the axes so far, renumbered after each: it stays below len(rows)^2.
    for axis in range(rows.shape[1]):
        values, place = np.unique(rows[:, axis], return_inverse=True)
        asked = _position(values, wanted[:, axis], found)
        keys, have = np.unique(have * len(values) + place, return_inverse=True)
        want = _position(keys, want * len(values) + asked, found)
    slot = np.empty(len(rows), np.int64)
    slot[have] = np.arange(len(rows))
    return np.where(found, slot[want], -1)


def _position(values: IntArray, wanted: IntArray, found: npt.NDArray[np.bool_]) -> IntArray:
    at = np.minimum(np.searchsorted(values, wanted), len(values) - 1)
    found &= values[at] == wanted
    return at.astype(np.int64)
