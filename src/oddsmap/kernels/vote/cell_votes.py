# SPDX-License-Identifier: Apache-2.0
"""Weights of single cells, 2D or 3D, gathered in a window and then added to tiles.

For sensors that list the cells of a reading themselves (a cone, a camera that sees the
cells): what the kernels of rays do not have to list, because it is
implied. The window is `rays3d.py`'s: a table of blocks, memory where a block is touched.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined, kernel
from oddsmap.kernels.units import HITS, PASSES
from oddsmap.kernels.vote.forgetting import scale_units
from oddsmap.kernels.vote.tiles import TileArrays, add_units, find_or_insert

__all__ = ["apply_counts", "gather_cells", "run_of_scans"]

IntArray = npt.NDArray[np.int64]


@borrowing
def gather_cells(
    index: IntArray,
    hits: IntArray,
    passes: IntArray,
    first: int,
    end: int,
    lo: IntArray,
    side: int,
    strides: IntArray,
    every_beam: bool,
    table: npt.NDArray[np.int32],
    used: IntArray,
    weights: IntArray,
) -> int:
    """Put the weights of some cells into a window.

    Args:
        index: cells, shape (n, d), x first; one may occur many times.
        hits: weights [1/65536 vote], shape (n,).
        passes: weights [1/65536 vote], shape (n,).
        first: which to begin with.
        end: past the last one.
        lo: first cell of the window, shape (d,), a multiple of `side`.
        side: cells along a block's side.
        strides: how far apart blocks are along each axis in the table, shape (d,).
        every_beam: True: weights add up; False: a cell keeps the largest.
        table: zeros, one for each block of the window.
        used: used[0] is how many blocks were touched; then their places in the table.
        weights: zeros, shape (2, cells of all blocks), block 0 unused.

    Returns:
        Which to go on with once there is room for more blocks; -1 when done.
    """
    # Scalars for three axes, the third of which is idle in 2D. Cells come in runs: most are in
    # the block of the one before, and need neither a division nor the table.
    in_3d = index.shape[1] == 3
    cells = side * side * side if in_3d else side * side
    room = used.shape[0] - 1
    block_x, block_y, block_z, at_block = lo[0] - side, lo[1], np.int64(0), np.int64(0)
    z = np.int64(0)
    for i in range(first, end):
        x, y = index[i, 0] - block_x, index[i, 1] - block_y
        if in_3d:
            z = index[i, 2] - block_z
        if not (0 <= x < side and 0 <= y < side and 0 <= z < side):
            along_x, along_y = (index[i, 0] - lo[0]) // side, (index[i, 1] - lo[1]) // side
            block = along_x * strides[0] + along_y * strides[1]
            block_x, block_y = lo[0] + along_x * side, lo[1] + along_y * side
            if in_3d:
                along_z = (index[i, 2] - lo[2]) // side
                block += along_z * strides[2]
                block_z = lo[2] + along_z * side
                z = index[i, 2] - block_z
            x, y = index[i, 0] - block_x, index[i, 1] - block_y
            slot = np.int64(table[block])
            if slot == 0:
                if used[0] == room:
                    return i
                used[0] += 1
                slot = used[0]
                table[block] = np.int32(slot)
                used[slot] = block
            at_block = slot * cells
        at = at_block + (z * side + y) * side + x
        if every_beam:
            weights[HITS, at] += hits[i]
            weights[PASSES, at] += passes[i]
        else:
            weights[HITS, at] = max(weights[HITS, at], hits[i])
            weights[PASSES, at] = max(weights[PASSES, at], passes[i])
    return -1


@borrowing
def run_of_scans(
    index: IntArray,
    offsets: IntArray,
    first: int,
    side: int,
    most_blocks: int,
    lo: IntArray,
    hi: IntArray,
) -> int:
    """The longest run of scans whose cells lie in a window of so many blocks; at least one scan.

    Args:
        index: cells, shape (n, d).
        offsets: first cell of each scan, and the end, shape (scans + 1,).
        first: scan to begin with.
        side: cells along a block's side.
        most_blocks: of the window of several scans; 0: one scan alone.
        lo: takes the first block of the window, shape (d,).
        hi: takes what lies past its last one, shape (d,). Equal to `lo`: no scan of the run has a
            cell.

    Returns:
        The scan after the run.
    """
    d = index.shape[1]
    lo[:] = 0
    hi[:] = 0
    empty = True
    for scan in range(first, offsets.shape[0] - 1):
        begin, end = offsets[scan], offsets[scan + 1]
        if begin == end:
            continue
        blocks = 1.0
        for axis in range(d):
            lowest, highest = _extent(index, begin, end, axis, side)
            if not empty:
                lowest, highest = min(lowest, lo[axis]), max(highest, hi[axis])
            blocks *= highest - lowest
        if not empty and blocks > most_blocks:
            return scan
        for axis in range(d):
            lowest, highest = _extent(index, begin, end, axis, side)
            lo[axis] = lowest if empty else min(lowest, lo[axis])
            hi[axis] = highest if empty else max(highest, hi[axis])
        empty = False
    return offsets.shape[0] - 1


@inlined
def _extent(index: IntArray, begin: int, end: int, axis: int, side: int) -> tuple[int, int]:
    # The first block of some cells along an axis, and what lies past the last one.
    lowest = highest = index[begin, axis]
    for i in range(begin, end):
        lowest, highest = min(lowest, index[i, axis]), max(highest, index[i, axis])
    return lowest // side, highest // side + 1


@kernel
def apply_counts(
    tiles: TileArrays,
    first_tile: IntArray,
    shape: IntArray,
    every_beam: bool,
    scale: int,
    table: npt.NDArray[np.int32],
    used: IntArray,
    weights: IntArray,
    lost: IntArray,
) -> bool:
    """Add a window's weights to tiles and zero them; False where a cell passed MAX_UNITS.

    Args:
        tiles: the tile store, with room for all used blocks.
        first_tile: tile coordinates of the window's first block, shape (d,).
        shape: blocks of the window along each axis, shape (d,), x first.
        every_beam: False: hits go before passes.
        scale: what the scan's votes weigh [1/65536], see `scale_units`.
        table: see `gather_cells`; zeros again afterwards, as are `used[0]` and `weights`.
        used: see `gather_cells`.
        weights: see `gather_cells`.
        lost: lost[0] grows by the weights above 0 that the scale has made 0.
    """
    d = first_tile.shape[0]
    key = np.empty(d, np.int64)
    cells = tiles.narrow.shape[2]
    fits = True
    for slot in range(1, used[0] + 1):
        remainder = used[slot]
        for axis in range(d):
            key[axis] = first_tile[axis] + remainder % shape[axis]
            remainder //= shape[axis]
        part = weights[:, slot * cells : (slot + 1) * cells]
        if not every_beam:
            for k in range(cells):
                if part[HITS, k] > 0:
                    part[PASSES, k] = 0
        lost[0] += scale_units(part[HITS], scale) + scale_units(part[PASSES], scale)
        if part.any():
            fits &= add_units(tiles, find_or_insert(tiles, key), part[HITS], part[PASSES])
        part[:] = 0
        table[used[slot]] = 0
    used[0] = 0
    return fits
