# SPDX-License-Identifier: Apache-2.0
"""Values of cells in blocks, as maps hold them, and as boxes and lists of cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.cell_index import cell_box, cell_indices, check_room

__all__ = ["cells_at", "dense_box", "listed_cells"]


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


def cells_at(blocks: IntArray, side: int, index: npt.ArrayLike) -> tuple[IntArray, IntArray]:
    """Where the values of single cells are in arrays of blocks, as `dense_box` takes them.

    Args:
        blocks: and side as in `dense_box`.
        side: see there.
        index: cells, shape (m, d), x first.

    Returns:
        block, -1 where there is none, and place of each in it, shape (m,).
    """
    d = blocks.shape[1]
    cells = cell_indices(index, d)
    place = np.ravel_multi_index(tuple((cells % side).T[::-1]), (side,) * d)
    if len(blocks) == 0:
        return np.full(len(cells), -1, np.int64), place.astype(np.int64)
    # Coordinates as one number each, in a box around all blocks.
    lo, hi = blocks.min(axis=0), blocks.max(axis=0) + 1
    shape = tuple(int(n) for n in hi - lo)
    wanted = cells // side
    inside = ((wanted >= lo) & (wanted < hi)).all(axis=1)
    codes = np.ravel_multi_index(tuple((blocks - lo).T), shape)
    order = np.argsort(codes, kind="stable")
    code = np.ravel_multi_index(tuple(np.where(inside[:, None], wanted - lo, 0).T), shape)
    found = order[np.minimum(np.searchsorted(codes[order], code), len(order) - 1)]
    return np.where(inside & (codes[found] == code), found, -1), place.astype(np.int64)


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
