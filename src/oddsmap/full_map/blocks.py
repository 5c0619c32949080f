# SPDX-License-Identifier: Apache-2.0
"""Values of cells in blocks, as maps hold them, and as boxes and lists of cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.cell_index import cell_box, check_room

__all__ = ["dense_box", "listed_cells"]


def dense_box(
    blocks: IntArray,
    side: int,
    values: npt.NDArray[np.generic],
    fill: float,
    lo: IntArray,
    hi: IntArray,
) -> FloatArray:
    """Values of a box of cells as an array, shape (ny, nx) or (nz, ny, nx).

    Args:
        blocks: coordinates of the blocks, in blocks, shape (n, d), x first.
        side: cells along a block's side.
        values: of each block's cells, shape (n, side^d), x fastest.
        fill: value of cells in no block.
        lo: first cell, shape (d,), x first.
        hi: past the last one.

    Raises:
        InputError: lo and hi are not d indices each, or hi < lo.
        MapTooLargeError: the box does not fit in memory.
    """
    d = blocks.shape[1]
    lo, hi = cell_box(lo, hi, d)
    check_room(lo, hi, 8)
    full = np.full((hi - lo)[::-1], fill, np.float64)
    shape = (side,) * d
    begin = blocks * side
    for at in np.flatnonzero(((begin + side > lo) & (begin < hi)).all(axis=1)):
        first, last = np.maximum(begin[at], lo), np.minimum(begin[at] + side, hi)
        cell = values[at].reshape(shape)
        full[_cut(first - lo, last - lo)] = cell[_cut(first - begin[at], last - begin[at])]
    return full


def listed_cells(
    blocks: IntArray, side: int, chosen: npt.NDArray[np.bool_]
) -> tuple[IntArray, IntArray, IntArray]:
    """The chosen cells in order of their index, x changing fastest.

    Args:
        blocks: and side as in `dense_box`.
        side: see there.
        chosen: shape (n, side^d).

    Returns:
        index, shape (m, d), x first; block and place of each in arrays like `chosen`, shape (m,).
    """
    block, place = np.nonzero(chosen)
    within = np.stack(np.unravel_index(place, (side,) * blocks.shape[1])[::-1], axis=1)
    index = blocks[block] * side + within
    order = np.lexsort(index.T)
    return index[order], block[order], place[order]


def _cut(first: IntArray, last: IntArray) -> tuple[slice, ...]:
    # Arrays have x as their last axis, indices as their first.
    return tuple(slice(int(a), int(b)) for a, b in zip(first[::-1], last[::-1], strict=True))
