# SPDX-License-Identifier: Apache-2.0
"""What is in the tiles: counts, sums and bounds in one pass.

Tiles are read as they lie, without widening them to 64 bits.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined
from oddsmap.kernels.units import FRACTION_BITS, HITS, ONE, PASSES
from oddsmap.kernels.vote.tiles import TileArrays

__all__ = [
    "CELLS", "FRACTION", "HIT_UNITS", "HIT_VOTES", "LARGEST", "PASS_UNITS", "PASS_VOTES", "TOTALS",
    "take_census", "weight_of",
]  # fmt: skip

IntArray = npt.NDArray[np.int64]

CELLS, HIT_VOTES, HIT_UNITS, PASS_VOTES, PASS_UNITS, LARGEST, FRACTION = range(7)
"""Totals: cells with a weight; sums of hits and passes, whole votes and the units beyond them apart
(units alone might not fit 64 bits); the largest weight [units]; the bits below a whole vote."""
TOTALS = 7


@inlined
def weight_of(tiles: TileArrays, slot: int, row: int, channel: int, cell: int) -> int:
    """Units of a cell of the tile in a slot, whose wide row is `row`, or none where that is < 0."""
    units = np.int64(tiles.narrow[slot, channel, cell]) << FRACTION_BITS
    if row >= 0:
        units += tiles.wide[row, channel, cell]
    return units


@borrowing
def take_census(
    tiles: TileArrays, slots: IntArray, side: int, lo: IntArray, hi: IntArray, totals: IntArray
) -> None:
    """Count, sum and bound the cells with a weight.

    Args:
        tiles: the tiles.
        slots: which of them.
        side: cells along the side of a tile.
        lo: lowered to the first index along each axis, shape (d,).
        hi: raised to one past the last index.
        totals: added to, see `CELLS` and what follows it; LARGEST is raised, FRACTION is joined.
    """
    for slot in slots:
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
                hits = weight_of(tiles, slot, row, HITS, cell)
                passes = weight_of(tiles, slot, row, PASSES, cell)
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
        if weight_of(tiles, slot, row, HITS, cell) | weight_of(tiles, slot, row, PASSES, cell) == 0:
            continue
        rest = cell
        for axis in range(lo.shape[0]):
            at = tiles.coords[slot, axis] * side + rest % side
            rest //= side
            lo[axis] = min(lo[axis], at)
            hi[axis] = max(hi[axis], at + 1)
