# SPDX-License-Identifier: Apache-2.0
"""A map in few pixels: the sums of the evidence in blocks of cells, columns of a 3D map as one.

Sums of hits and passes are the evidence of the coarser map, exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import FRACTION_BITS, HITS, ONE, PASSES

__all__ = ["Overview", "overview_of"]

# As many tiles at a time: a few megabytes.
_PART = 1024


class Overview(NamedTuple):
    """Evidence of blocks of cells, row = y ascending."""

    hits: npt.NDArray[np.float64]
    """Sums [votes], shape (ny, nx)."""
    passes: npt.NDArray[np.float64]
    """Likewise."""
    block: int
    """Cells along the side of a block."""
    first: IntArray
    """The first cell, shape (2,), x first."""


def overview_of(tiles: TileStore, most: int) -> Overview | None:
    """Add up evidence from above, in at most so many blocks along each side.

    Args:
        tiles: of a 2D or 3D map.
        most: blocks along a side, at least 2: the map's origin is a border of blocks of any size.

    Returns:
        The sums, in blocks of 2^k cells; None where there are no tiles.
    """
    if not tiles.count:
        return None
    side, plane = tiles.side, tiles.coords[:, :2]
    low, past = plane.min(axis=0) * side, (plane.max(axis=0) + 1) * side
    block = 1
    while int((-(-past // block) - low // block).max()) > most:
        block *= 2
    first = low // block
    width, height = (int(n) for n in -(-past // block) - first)
    sums = np.zeros((2, height * width), np.int64)
    for start in range(0, tiles.count, _PART):
        _add(tiles, slice(start, start + _PART), block, first, width, sums)
    hits, passes = (sums[channel].reshape(height, width) / ONE for channel in (HITS, PASSES))
    return Overview(hits, passes, block, first * block)


def _add(
    tiles: TileStore, slots: slice, block: int, first: IntArray, width: int, sums: IntArray
) -> None:
    """Add the evidence of some tiles to that of their blocks."""
    side, arrays = tiles.side, tiles.arrays
    coords = tiles.coords[slots]
    count = len(coords)
    shape = (count, 2, *(side,) * tiles.ndim)
    narrow = arrays.narrow[slots][:count].reshape(shape)
    votes = (narrow.sum(axis=2) if tiles.ndim == 3 else narrow).astype(np.int64) << FRACTION_BITS
    rows = arrays.wide_of[slots][:count]
    if (rows >= 0).any():
        wide = arrays.wide[rows[rows >= 0]].reshape(-1, *shape[1:])
        votes[rows >= 0] += wide.sum(axis=2) if tiles.ndim == 3 else wide
    cell = np.arange(side)
    x, y = ((coords[:, axis, None] * side + cell) // block - first[axis] for axis in (0, 1))
    place = (y[:, :, None] * width + x[:, None, :]).ravel()
    for channel in (HITS, PASSES):
        np.add.at(sums[channel], place, votes[:, channel].ravel())
