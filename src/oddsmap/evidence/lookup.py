# SPDX-License-Identifier: Apache-2.0
"""Single cells: their place in another grid, and their votes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.cell_index import cell_indices
from oddsmap.evidence.evidence import Evidence

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
    cells = cell_indices(index, evidence.ndim)
    return evidence.tiles.at(cells)
