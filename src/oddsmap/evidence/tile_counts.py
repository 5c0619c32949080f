# SPDX-License-Identifier: Apache-2.0
"""Tiles as they are stored, in counts of one unit, and tiles from those."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import FRACTION_BITS, HITS, ONE, PASSES
from oddsmap.kernels.vote.tiles import ANY_FULL, NARROW_MAX, TILE_COUNT, WIDE_COUNT, enter

__all__ = ["append_counts", "counts_of", "retiled"]


def counts_of(
    tiles: TileStore, slots: IntArray, unit: int, dtype: npt.DTypeLike
) -> npt.NDArray[Any]:
    """Weights of some tiles as counts.

    Args:
        tiles: the tiles.
        slots: which, shape (n,).
        unit: units in one count, 1 or those of a vote; every weight is a multiple of it.
        dtype: of unsigned integers that hold each count.

    Returns:
        Hits and passes, shape (n, 2, cells of a tile).
    """
    shift = unit.bit_length() - 1
    counts = tiles.arrays.narrow[slots].astype(dtype, copy=False)
    if unit != ONE:
        counts <<= FRACTION_BITS - shift
    wide = tiles.arrays.wide_of[slots] >= 0
    if wide.any():
        counts[wide] = tiles.units(slots[wide]) >> shift
    return counts


def append_counts(
    tiles: TileStore,
    coords: IntArray,
    hits: npt.NDArray[Any],
    passes: npt.NDArray[Any],
    unit: int,
) -> None:
    """Make tiles of counts: `counts_of` undone. Tiles without a weight are not made.

    Args:
        tiles: has none of them yet.
        coords: of the tiles, shape (n, d), x first, each once.
        hits: unsigned integers, none beyond `HEAVIEST` units, shape (n, cells of a tile).
        passes: likewise.
        unit: units in one count, 1 or those of a vote.

    Raises:
        MapTooLargeError: no memory for the tiles; nothing has been added.
    """
    largest = np.maximum(hits.max(axis=1), passes.max(axis=1))
    some = np.flatnonzero(largest)
    if len(some) == 0:
        return
    is_wide = (largest[some] > NARROW_MAX) | (unit != ONE)
    first, first_row = tiles.count, int(tiles.arrays.counts[WIDE_COUNT])
    rows = int(is_wide.sum())
    tiles.reserve(len(some), rows)
    arrays = tiles.arrays
    slots = np.arange(first, first + len(some))
    arrays.coords[slots] = coords[some]
    arrays.wide_of[slots] = -1
    narrow, of_narrow = slots[~is_wide], some[~is_wide]
    arrays.narrow[narrow, HITS] = hits[of_narrow]
    arrays.narrow[narrow, PASSES] = passes[of_narrow]
    arrays.load[narrow] = largest[of_narrow]
    if rows:
        wide, of_wide = np.arange(first_row, first_row + rows), some[is_wide]
        arrays.wide_of[slots[is_wide]] = wide
        shift = unit.bit_length() - 1
        arrays.wide[wide, HITS] = hits[of_wide].astype(np.int64) << shift
        arrays.wide[wide, PASSES] = passes[of_wide].astype(np.int64) << shift
        arrays.counts[WIDE_COUNT] += rows
    if (largest[of_narrow] == NARROW_MAX).any():
        arrays.counts[ANY_FULL] = 1
    arrays.counts[TILE_COUNT] += len(some)
    enter(arrays, first)


def retiled(tiles: TileStore, side: int) -> TileStore:
    """The same weights in tiles of another side."""
    d = tiles.ndim
    others = TileStore(d, side)
    for coords, units in tiles.chunks():
        tile, cell = np.nonzero(units.any(axis=1))
        within = np.stack(np.unravel_index(cell, (tiles.side,) * d)[::-1], axis=1)
        index = coords[tile] * tiles.side + within
        of, which = np.unique(index // side, axis=0, return_inverse=True)
        place = np.ravel_multi_index(tuple((index % side).T[::-1]), (side,) * d)
        whole = np.zeros((len(of), 2, side**d), np.int64)
        whole[which.ravel(), :, place] = units[tile, :, cell]
        others.fill(of, whole)
    return others
