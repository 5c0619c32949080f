# SPDX-License-Identifier: Apache-2.0
"""What is in the tiles: counts, sums and bounds in one pass, and the cells in order.

Tiles are read as they lie, without widening them to 64 bits and without sorting cells: tiles are
sorted, and cells inside a tile have an order already.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined
from oddsmap.kernels.units import FRACTION_BITS, HITS, ONE, PASSES
from oddsmap.kernels.vote.tiles import TILE_COUNT, TileArrays

__all__ = [
    "CELLS", "FRACTION", "HIT_UNITS", "HIT_VOTES", "LARGEST", "PASS_UNITS", "PASS_VOTES", "TOTALS",
    "list_cells", "take_census",
]  # fmt: skip

IntArray = npt.NDArray[np.int64]

CELLS, HIT_VOTES, HIT_UNITS, PASS_VOTES, PASS_UNITS, LARGEST, FRACTION = range(7)
"""Totals: cells with a weight; sums of hits and passes, whole votes and the units beyond them apart
(units alone might not fit 64 bits); the largest weight [units]; the bits below a whole vote."""
TOTALS = 7


@inlined
def _weight(tiles: TileArrays, slot: int, row: int, channel: int, cell: int) -> int:
    units = np.int64(tiles.narrow[slot, channel, cell]) << FRACTION_BITS
    if row >= 0:
        units += tiles.wide[row, channel, cell]
    return units


@borrowing
def take_census(tiles: TileArrays, side: int, lo: IntArray, hi: IntArray, totals: IntArray) -> None:
    """Count, sum and bound the cells with a weight.

    Args:
        tiles: the tiles.
        side: cells along the side of a tile.
        lo: lowered to the first index along each axis, shape (d,).
        hi: raised to one past the last index.
        totals: added to, see `CELLS` and what follows it; LARGEST is raised, FRACTION is joined.
    """
    for slot in range(tiles.counts[TILE_COUNT]):
        row = tiles.wide_of[slot]
        narrow = tiles.narrow[slot]
        known, hits, passes = np.int64(0), np.int64(0), np.int64(0)
        if row < 0:
            # Bytes, as most tiles have: 0.26 us for one of 512 cells.
            largest = np.uint8(0)
            for cell in range(narrow.shape[1]):
                h, p = narrow[HITS, np.uint64(cell)], narrow[PASSES, np.uint64(cell)]
                known += np.int64((h | p) != 0)
                hits += np.int64(h)
                passes += np.int64(p)
                largest = max(largest, max(h, p))
            totals[HIT_VOTES] += hits
            totals[PASS_VOTES] += passes
            totals[LARGEST] = max(totals[LARGEST], np.int64(largest) << FRACTION_BITS)
        else:
            for cell in range(narrow.shape[1]):
                hits = _weight(tiles, slot, row, HITS, cell)
                passes = _weight(tiles, slot, row, PASSES, cell)
                known += np.int64((hits | passes) != 0)
                totals[HIT_VOTES] += hits >> FRACTION_BITS
                totals[HIT_UNITS] += hits & (ONE - 1)
                totals[PASS_VOTES] += passes >> FRACTION_BITS
                totals[PASS_UNITS] += passes & (ONE - 1)
                totals[LARGEST] = max(totals[LARGEST], max(hits, passes))
                totals[FRACTION] |= (hits | passes) & (ONE - 1)
        totals[CELLS] += known
        if known > 0:
            _widen(tiles, slot, row, side, lo, hi)


@borrowing
def _widen(tiles: TileArrays, slot: int, row: int, side: int, lo: IntArray, hi: IntArray) -> None:
    # Only tiles that reach over the box so far are looked at cell by cell.
    reaches = False
    for axis in range(lo.shape[0]):
        begin = tiles.coords[slot, axis] * side
        reaches |= begin < lo[axis] or begin + side > hi[axis]
    if not reaches:
        return
    for cell in range(tiles.narrow.shape[2]):
        if _weight(tiles, slot, row, HITS, cell) | _weight(tiles, slot, row, PASSES, cell) == 0:
            continue
        rest = cell
        for axis in range(lo.shape[0]):
            at = tiles.coords[slot, axis] * side + rest % side
            rest //= side
            lo[axis] = min(lo[axis], at)
            hi[axis] = max(hi[axis], at + 1)


@borrowing
def list_cells(
    tiles: TileArrays,
    side: int,
    order: IntArray,
    rows: IntArray,
    index: IntArray,
    hits: IntArray,
    passes: IntArray,
) -> int:
    """List the cells with a weight in order of their index, x changing fastest.

    Args:
        tiles: the tiles.
        side: cells along the side of a tile.
        order: slots of the tiles in order of their coordinates, x changing fastest, shape (n,).
        rows: where tiles of another y or z begin in `order`, and its end.
        index: filled, shape (cells, d), x first.
        hits: filled, shape (cells,) [units].
        passes: likewise.

    Returns:
        How many cells there are.
    """
    in_space = index.shape[1] == 3
    layers = side if in_space else 1
    found, first = 0, 0
    while first < rows.shape[0] - 1:
        # In space the rows of tiles that share z are gone through layer by layer.
        past = first + 1
        z_tile = tiles.coords[order[rows[first]], 2] if in_space else np.int64(0)
        while in_space and past < rows.shape[0] - 1:
            if tiles.coords[order[rows[past]], 2] != z_tile:
                break
            past += 1
        for z in range(layers):
            for run in range(first, past):
                for y in range(side):
                    begin = (z * side + y) * side
                    for i in range(rows[run], rows[run + 1]):
                        slot = order[i]
                        row = tiles.wide_of[slot]
                        for x in range(side):
                            h = _weight(tiles, slot, row, HITS, begin + x)
                            p = _weight(tiles, slot, row, PASSES, begin + x)
                            if h | p == 0:
                                continue
                            index[found, 0] = tiles.coords[slot, 0] * side + x
                            index[found, 1] = tiles.coords[slot, 1] * side + y
                            if in_space:
                                index[found, 2] = z_tile * side + z
                            hits[found], passes[found] = h, p
                            found += 1
        first = past
    return found
