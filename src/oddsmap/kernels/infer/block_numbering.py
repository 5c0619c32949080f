# SPDX-License-Identifier: Apache-2.0
"""Cells of a window become numbers: blocks of cells are numbered in the order of their first use.

Memory is then one row per cell of the blocks that beams touch, however large the window is.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import inlined, kernel

__all__ = ["find_blocks", "number_cells"]

IntArray = npt.NDArray[np.int64]
Places = npt.NDArray[np.signedinteger]


@inlined
def _split(place: int, shape: IntArray, side: int, strides: IntArray) -> tuple[int, int]:
    # Block of the window, and place in the block, of a place in the window (x fastest in all).
    remainder, block, within, span = np.int64(place), np.int64(0), np.int64(0), np.int64(1)
    for axis in range(shape.shape[0]):
        cell = remainder % shape[axis]
        remainder //= shape[axis]
        along = cell // side
        block += along * strides[axis]
        within += (cell - along * side) * span
        span *= side
    return block, within


@kernel
def find_blocks(
    places: Places,
    shape: IntArray,
    side: int,
    strides: IntArray,
    table: npt.NDArray[np.int32],
    found: IntArray,
) -> int:
    """List the blocks that some cells are in and that the table does not know yet.

    Args:
        places: of cells in the window, x fastest, shape (n,).
        shape: cells of the window along each axis, multiples of `side`, shape (d,), x first.
        side: cells along a block's side.
        strides: how far apart blocks are along each axis in the table, shape (d,).
        table: -1 for each unknown block of the window; becomes -2 for those that are listed.
        found: takes the blocks, shape (blocks of the window,) at most.

    Returns:
        How many were listed.
    """
    count = 0
    for i in range(places.shape[0]):
        block, _ = _split(places[i], shape, side, strides)
        if table[block] == -1:
            table[block] = -2
            found[count] = block
            count += 1
    return count


@kernel
def number_cells(
    places: Places,
    shape: IntArray,
    side: int,
    strides: IntArray,
    table: npt.NDArray[np.int32],
    numbers: npt.NDArray[np.int32],
) -> None:
    """Number of each cell: its block's number times the cells of a block, and its place there.

    Args:
        places: and the next three as in `find_blocks`.
        shape: see there.
        side: see there.
        strides: see there.
        table: the number of each block.
        numbers: takes the cells' numbers, shape (n,).
    """
    cells = side ** shape.shape[0]
    for i in range(places.shape[0]):
        block, within = _split(places[i], shape, side, strides)
        numbers[i] = np.int32(table[block] * cells + within)
