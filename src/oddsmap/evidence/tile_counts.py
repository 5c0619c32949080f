# SPDX-License-Identifier: Apache-2.0
"""Tiles as they are stored, in counts of one unit, and tiles from those."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import FRACTION_BITS, HITS, ONE, PASSES
from oddsmap.kernels.vote.tiles import (
    ANY_FULL,
    NARROW_MAX,
    TILE_COUNT,
    WIDE_COUNT,
    TileArrays,
    enter,
)

__all__ = ["append_counts", "counts_of", "retiled"]


def counts_of(
    tiles: TileStore, slots: IntArray, channel: int, unit: int, dtype: npt.DTypeLike
) -> npt.NDArray[Any]:
    """Weights of one kind of some tiles as counts.

    Args:
        tiles: the tiles.
        slots: which, shape (n,).
        channel: HITS or PASSES.
        unit: units in one count, 1 or those of a vote; every weight is a multiple of it.
        dtype: of unsigned integers that hold each count.

    Returns:
        Shape (n, cells of a tile).
    """
    shift = unit.bit_length() - 1
    counts: npt.NDArray[Any] = tiles.arrays.narrow[slots, channel].astype(dtype, copy=False)
    if unit != ONE:
        counts <<= FRACTION_BITS - shift
    rows = tiles.arrays.wide_of[slots]
    is_wide = rows >= 0
    if is_wide.any():
        counts[is_wide] += (tiles.arrays.wide[rows[is_wide], channel] >> shift).astype(dtype)
    return counts


def append_counts(
    tiles: TileStore,
    coords: IntArray,
    hits: npt.NDArray[Any],
    passes: npt.NDArray[Any],
    unit: int,
) -> None:
    """Make tiles of counts: `counts_of` undone.

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
    is_wide = (largest > NARROW_MAX) | (unit != ONE)
    rows = int(is_wide.sum())
    tiles.reserve(len(coords), rows)
    arrays, first, first_row = tiles.arrays, tiles.count, int(tiles.arrays.counts[WIDE_COUNT])
    new = slice(first, first + len(coords))
    arrays.coords[new] = coords
    arrays.wide_of[new] = -1
    if rows == 0:
        _set_narrow(arrays, new, hits, passes, largest)
    else:
        in_bytes = np.flatnonzero(~is_wide)
        _set_narrow(arrays, first + in_bytes, hits[in_bytes], passes[in_bytes], largest[in_bytes])
        wide, shift = slice(first_row, first_row + rows), unit.bit_length() - 1
        arrays.wide_of[new][is_wide] = np.arange(first_row, first_row + rows)
        arrays.wide[wide, HITS] = hits[is_wide].astype(np.int64) << shift
        arrays.wide[wide, PASSES] = passes[is_wide].astype(np.int64) << shift
        arrays.counts[WIDE_COUNT] += rows
    arrays.counts[TILE_COUNT] += len(coords)
    enter(arrays, first)


def _set_narrow(
    arrays: TileArrays,
    slots: slice | IntArray,
    hits: npt.NDArray[Any],
    passes: npt.NDArray[Any],
    largest: npt.NDArray[Any],
) -> None:
    arrays.narrow[slots, HITS] = hits
    arrays.narrow[slots, PASSES] = passes
    arrays.load[slots] = largest
    if (largest == NARROW_MAX).any():
        arrays.counts[ANY_FULL] = 1


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
