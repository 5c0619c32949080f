# SPDX-License-Identifier: Apache-2.0
"""Sparse tiles of hits and passes: hash lookup, and adding without losing a vote.

Each tile has two levels. `narrow` counts whole votes in one byte per cell and takes almost every
addition; before a byte could overflow, the tile is flushed into `wide`, which counts in units of
1/65536 vote in 64 bits and also takes fractional votes. A cell's weight is the sum of the two.
Most tiles of a 3D map never need `wide`, so a cell costs 2 bytes.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.units import FRACTION_BITS, HITS, MAX_UNITS, ONE, PASSES

__all__ = [
    "NARROW_MAX",
    "Hashed",
    "TileArrays",
    "add_tiles",
    "add_units",
    "enter",
    "find",
    "find_or_insert",
    "flush",
    "grow_load",
    "has_room",
    "make_room_for_vote",
    "wide_row",
]

NARROW_MAX = 255

TILE_COUNT, WIDE_COUNT, ANY_FULL = 0, 1, 2


class Hashed(Protocol):
    """What `find` and `enter` read of tiles, or of blocks that are kept alike."""

    @property
    def table(self) -> npt.NDArray[np.int64]:
        """See `TileArrays`."""

    @property
    def coords(self) -> npt.NDArray[np.int64]:
        """Likewise."""

    @property
    def counts(self) -> npt.NDArray[np.int64]:
        """Of these, how many tiles are used, first."""


class TileArrays(NamedTuple):
    """The arrays of one tile store, in one tuple so that kernels can take them together."""

    table: npt.NDArray[np.int64]
    """Open-addressing hash, a power of two long: slot of a tile, or -1."""
    coords: npt.NDArray[np.int64]
    """Tile coordinates of each slot, shape (capacity, d), x first."""
    load: npt.NDArray[np.uint8]
    """The most that any cell's `narrow` count can be, per slot."""
    wide_of: npt.NDArray[np.int32]
    """Row in `wide`, or -1, per slot."""
    counts: npt.NDArray[np.int64]
    """Tiles used, wide rows used, 1 once any tile's load has reached NARROW_MAX."""
    narrow: npt.NDArray[np.uint8]
    """Whole votes, shape (capacity, 2, cells of a tile)."""
    wide: npt.NDArray[np.int64]
    """Units of 1/65536 vote, shape (wide capacity, 2, cells of a tile)."""


@borrowing
def _hash(key: npt.NDArray[np.int64]) -> np.uint64:
    # 64-bit finaliser of SplitMix64 (Steele, Lea, Flood 2014): neighbours land far apart.
    h = np.uint64(0)
    for axis in range(key.shape[0]):
        h = (h ^ np.uint64(key[axis])) * np.uint64(0xBF58476D1CE4E5B9)
        h ^= h >> np.uint64(29)
    return h


@borrowing
def find(tiles: Hashed, key: npt.NDArray[np.int64]) -> int:
    """Slot of the tile at `key` (shape (d,)), or -1."""
    mask = np.uint64(tiles.table.shape[0] - 1)
    at = _hash(key) & mask
    while True:
        slot = tiles.table[at]
        if slot < 0:
            return -1
        same = True
        for axis in range(key.shape[0]):
            if tiles.coords[slot, axis] != key[axis]:
                same = False
        if same:
            return slot
        at = (at + np.uint64(1)) & mask


@borrowing
def find_or_insert(tiles: TileArrays, key: npt.NDArray[np.int64]) -> int:
    """Slot of the tile at `key`, made where it is new. The caller has ensured the capacity."""
    mask = np.uint64(tiles.table.shape[0] - 1)
    at = _hash(key) & mask
    while True:
        slot = tiles.table[at]
        if slot < 0:
            break
        same = True
        for axis in range(key.shape[0]):
            if tiles.coords[slot, axis] != key[axis]:
                same = False
        if same:
            return slot
        at = (at + np.uint64(1)) & mask
    slot = tiles.counts[TILE_COUNT]
    tiles.counts[TILE_COUNT] += 1
    tiles.table[at] = slot
    for axis in range(key.shape[0]):
        tiles.coords[slot, axis] = key[axis]
    tiles.wide_of[slot] = -1
    return slot


@borrowing
def enter(tiles: Hashed, first: int) -> None:
    """Enter the tiles from a slot on into the table, which has none of them."""
    mask = np.uint64(tiles.table.shape[0] - 1)
    for slot in range(first, tiles.counts[TILE_COUNT]):
        at = _hash(tiles.coords[slot]) & mask
        while tiles.table[at] >= 0:
            at = (at + np.uint64(1)) & mask
        tiles.table[at] = slot


@borrowing
def has_room(tiles: TileArrays, touched: int, fractional: bool) -> bool:
    """Whether `touched` tiles can be added to, whichever they are, so that none is left half done.

    Whole votes need wide rows only once a tile is full; `fractional` weights may always need them.
    """
    after = tiles.counts[TILE_COUNT] + touched
    if after > tiles.coords.shape[0] or 2 * after > tiles.table.shape[0]:
        return False
    if not fractional and tiles.counts[ANY_FULL] == 0:
        return True
    return tiles.counts[WIDE_COUNT] + touched <= tiles.wide.shape[0]


@borrowing
def wide_row(tiles: TileArrays, slot: int) -> int:
    """Row of the tile in `wide`, made where it has none. The caller has ensured the capacity."""
    row = tiles.wide_of[slot]
    if row < 0:
        row = tiles.counts[WIDE_COUNT]
        tiles.counts[WIDE_COUNT] += 1
        tiles.wide_of[slot] = row
    return row


@borrowing
def flush(tiles: TileArrays, slot: int) -> bool:
    """Move a tile's narrow counts to its wide row; False where a cell passed MAX_UNITS."""
    row = wide_row(tiles, slot)
    fits = True
    for channel in range(2):
        narrow, wide = tiles.narrow[slot, channel], tiles.wide[row, channel]
        for cell in range(narrow.shape[0]):
            wide[cell] += np.int64(narrow[cell]) << FRACTION_BITS
            narrow[cell] = 0
            if wide[cell] > MAX_UNITS:
                fits = False
    tiles.load[slot] = 0
    return fits


@borrowing
def grow_load(tiles: TileArrays, slot: int, votes: int) -> None:
    """Note that cells of a tile have grown by up to so many whole votes, which it had room for."""
    tiles.load[slot] += np.uint8(votes)
    if tiles.load[slot] == NARROW_MAX:
        tiles.counts[ANY_FULL] = 1


@borrowing
def make_room_for_vote(tiles: TileArrays, slot: int) -> bool:
    """Let every cell of a tile take one more whole vote; False where a cell passed MAX_UNITS."""
    fits = True
    if tiles.load[slot] == NARROW_MAX:
        fits = flush(tiles, slot)
    grow_load(tiles, slot, 1)
    return fits


@borrowing
def add_units(
    tiles: TileArrays,
    slot: int,
    hits: npt.NDArray[np.int64],
    passes: npt.NDArray[np.int64],
) -> bool:
    """Add units, shape (cells of a tile,) each, to one tile; False where a cell passed MAX_UNITS.

    Whole votes that fit a byte go to `narrow`, everything else to `wide`.
    """
    max_weight, fraction = np.int64(0), np.int64(0)
    for cell in range(hits.shape[0]):
        max_weight = max(max_weight, hits[cell], passes[cell])
        fraction |= hits[cell] | passes[cell]
    votes = max_weight >> FRACTION_BITS
    if fraction & (ONE - 1) == 0 and tiles.load[slot] + votes <= NARROW_MAX:
        narrow = tiles.narrow[slot]
        for cell in range(hits.shape[0]):
            narrow[HITS, cell] += np.uint8(hits[cell] >> FRACTION_BITS)
            narrow[PASSES, cell] += np.uint8(passes[cell] >> FRACTION_BITS)
        grow_load(tiles, slot, votes)
        return True
    row = wide_row(tiles, slot)
    fits = True
    for cell in range(hits.shape[0]):
        tiles.wide[row, HITS, cell] += hits[cell]
        tiles.wide[row, PASSES, cell] += passes[cell]
        if max(tiles.wide[row, HITS, cell], tiles.wide[row, PASSES, cell]) > MAX_UNITS:
            fits = False
    return fits


@borrowing
def add_tiles(
    tiles: TileArrays,
    coords: npt.NDArray[np.int64],
    units: npt.NDArray[np.int64],
) -> bool:
    """Add whole tiles of units: coords (n, d), units (n, 2, cells of a tile)."""
    fits = True
    for i in range(coords.shape[0]):
        slot = find_or_insert(tiles, coords[i])
        fits &= add_units(tiles, slot, units[i, HITS], units[i, PASSES])
    return fits
