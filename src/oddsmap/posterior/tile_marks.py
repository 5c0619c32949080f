# SPDX-License-Identifier: Apache-2.0
"""Marks of a box's cells by their votes, tile by tile: no cell is listed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.query.distances import mark_cells
from oddsmap.kernels.query.tile_marks import mark_tiles
from oddsmap.kernels.units import ONE

__all__ = ["WHOLE_VOTES", "Marks", "OfVotes", "marks_of_box"]

Marks = npt.NDArray[np.uint8]
OfVotes = Callable[[FloatArray, FloatArray], Marks]

WHOLE_VOTES = tuple(np.stack(np.divmod(np.arange(1 << 16), 256)).astype(np.float64))
"""All pairs of hits and passes that fit in a byte each, hits * 256 + passes."""

_CHUNK = 4096
"""Tiles of more than whole votes handled at a time."""


def marks_of_box(tiles: TileStore, region: Region, of_whole: Marks, of_votes: OfVotes) -> Marks:
    """What a function of votes gives for each cell of a box.

    Args:
        tiles: the evidence.
        region: the box, (lo, hi), hi past the last.
        of_whole: the function of `WHOLE_VOTES`; that of no votes is also given outside all tiles.
        of_votes: the function, of hits and passes [votes].

    Returns:
        Shape (ny, nx) or (nz, ny, nx).
    """
    lo, hi = (np.asarray(end, np.int64) for end in region)
    mask = np.full(tuple((hi - lo)[::-1]), of_whole[0], np.uint8)
    if mask.size == 0 or tiles.count == 0:
        return mask
    flat, side = mask.reshape(-1), tiles.side
    near = (tiles.coords >= lo // side) & (tiles.coords < -(-hi // side))
    slots = np.flatnonzero(np.all(near, axis=1))
    wide = tiles.arrays.wide_of[slots] >= 0
    mark_tiles(tiles.arrays.narrow, tiles.arrays.coords, slots[~wide], side, of_whole, lo, hi, flat)
    within = _cells_of_tile(tiles)
    for start in range(0, np.count_nonzero(wide), _CHUNK):
        part = slots[wide][start : start + _CHUNK]
        hits, passes = tiles.units(part).swapaxes(0, 1)
        index = (tiles.arrays.coords[part, None] * side + within).reshape(-1, tiles.ndim)
        mark_cells(index, of_votes(hits.ravel() / ONE, passes.ravel() / ONE), lo, hi, flat)
    return mask


def _cells_of_tile(tiles: TileStore) -> IntArray:
    """Where the cells of a tile are in it, x fastest, shape (cells, d), x first."""
    axes = np.indices((tiles.side,) * tiles.ndim).reshape(tiles.ndim, -1)
    return np.ascontiguousarray(axes[::-1].T).astype(np.int64)
