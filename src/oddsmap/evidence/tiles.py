# SPDX-License-Identifier: Apache-2.0
"""The memory of an evidence map: sparse tiles that grow in every direction."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from typing import Any, NamedTuple, Self

import numpy as np

from oddsmap.array_types import IntArray, Region
from oddsmap.errors import ConfigError, MapTooLargeError
from oddsmap.evidence.packed_tiles import PackedTiles, pack_tiles
from oddsmap.kernels.units import FRACTION_BITS, MAX_UNITS
from oddsmap.kernels.vote.tile_census import (
    CELLS,
    FRACTION,
    HIT_UNITS,
    HIT_VOTES,
    LARGEST,
    PASS_UNITS,
    PASS_VOTES,
    TOTALS,
    take_census,
)
from oddsmap.kernels.vote.tile_listing import list_cells
from oddsmap.kernels.vote.tile_lookup import look_up
from oddsmap.kernels.vote.tiles import (
    ANY_FULL,
    TILE_COUNT,
    WIDE_COUNT,
    TileArrays,
    add_tiles,
    enter,
)
from oddsmap.limits import memory_limit

__all__ = ["HEAVIEST", "NOTHING", "PART", "Census", "TileStore", "distinct_rows"]

HEAVIEST = MAX_UNITS + (255 << FRACTION_BITS)
"""The most units of a cell: 255 whole votes are counted apart before the limit is looked at."""

PART = 1 << 16
"""Cells handled at a time where not all need be: what is made of them stays in the cache."""

# Slots of an empty hash table, a power of two.
_MIN_SLOTS = 16
# Rows are taken many at a time: they cost only address space until they are used, but moving them
# costs twice the memory and, at 0.05 m, 5 to 20 % of the time.
_GROWTH = 8
# Tiles handled at a time where they are widened to 64 bits: bounds the memory that takes.
_CHUNK_TILES = 4096


# No index is as large as this.
_NOWHERE = 1 << 62


class Census(NamedTuple):
    """What is in a store of tiles."""

    cells: int
    """How many have a weight."""
    hits: int
    """Sum of their hits, in units of 1/65536 vote."""
    passes: int
    """Likewise."""
    largest: int
    """The largest weight of one cell, likewise."""
    whole_votes: bool
    """Whether every weight is a number of whole votes."""
    bounds: tuple[IntArray, IntArray] | None
    """First index and one past the last, shape (ndim,) each, x first; None where it is empty."""

    def joined(self, other: Census) -> Census:
        """What is in two stores that have no cell in common."""
        boxes = [box for box in (self.bounds, other.bounds) if box is not None]
        return Census(
            cells=self.cells + other.cells,
            hits=self.hits + other.hits,
            passes=self.passes + other.passes,
            largest=max(self.largest, other.largest),
            whole_votes=self.whole_votes and other.whole_votes,
            bounds=(
                np.min([lo for lo, _ in boxes], axis=0), np.max([hi for _, hi in boxes], axis=0)
            ) if boxes else None,
        )  # fmt: skip


NOTHING = Census(0, 0, 0, 0, True, None)
"""What is in an empty store."""


class TileStore:
    """Hits and passes in tiles of `side`^`ndim` cells, found by hash.

    Args:
        ndim: 2 or 3.
        side: cells along a tile's side. It changes speed and memory, never a weight.
    """

    def __init__(self, ndim: int, side: int) -> None:
        if ndim not in (2, 3) or not 1 <= side <= 1024:
            raise ConfigError(f"tiles need 2 or 3 axes and a side of 1..1024, got {ndim}, {side}")
        self.ndim = ndim
        self.side = side
        self.arrays = self._empty(0, 0)

    def like(self) -> TileStore:
        """An empty store of the same shape."""
        return TileStore(self.ndim, self.side)

    def _empty(self, tiles: int, wide: int) -> TileArrays:
        cells = self.side**self.ndim
        # np.zeros takes address space; memory only where a tile is used.
        return TileArrays(
            table=np.full(_MIN_SLOTS, -1, np.int64),
            coords=np.zeros((tiles, self.ndim), np.int64),
            load=np.zeros(tiles, np.uint8),
            wide_of=np.zeros(tiles, np.int32),
            counts=np.zeros(3, np.int64),
            narrow=np.zeros((tiles, 2, cells), np.uint8),
            wide=np.zeros((wide, 2, cells), np.int64),
        )

    def __getstate__(self) -> dict[str, Any]:
        """What pickle takes: the rows in use, packed, without the table."""
        return pack_tiles(self.arrays, self.side)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """The inverse of `__getstate__`; errors as of `PackedTiles`."""
        packed = PackedTiles(state)
        self.ndim, self.side = packed.ndim, packed.side
        self.arrays = self._empty(packed.used, packed.rows)
        packed.fill(self.arrays)
        slots = _MIN_SLOTS
        while slots < 2 * self.count:
            slots *= 2
        self.arrays = self.arrays._replace(table=np.full(slots, -1, np.int64))
        enter(self.arrays, 0)

    def __copy__(self) -> Self:
        """The rows in use, without spare rows; nothing is shared."""
        twin = type(self)(self.ndim, self.side)
        used, used_wide = self.count, int(self.arrays.counts[WIDE_COUNT])
        arrays, rows = self._empty(used, used_wide), self.arrays
        arrays.counts[:] = rows.counts
        for name in ("coords", "load", "wide_of", "narrow"):
            getattr(arrays, name)[:] = getattr(rows, name)[:used]
        arrays.wide[:] = rows.wide[:used_wide]
        twin.arrays = arrays._replace(table=rows.table.copy())
        return twin

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Likewise, without what pickle packs."""
        return copy.copy(self)

    @property
    def count(self) -> int:
        """Tiles in use."""
        return int(self.arrays.counts[TILE_COUNT])

    @property
    def any_full(self) -> bool:
        """True once a tile may need a wide row for one more whole vote."""
        return bool(self.arrays.counts[ANY_FULL])

    @property
    def coords(self) -> IntArray:
        """Tile coordinates, shape (count, ndim), x first, in order of first use."""
        return self.arrays.coords[: self.count]

    @property
    def nbytes(self) -> int:
        """Bytes in use."""
        rows = self._bytes(self.count, int(self.arrays.counts[WIDE_COUNT]))
        return int(self.arrays.table.nbytes) + rows

    def _bytes(self, tiles: int, wide: int) -> int:
        per_tile: int = 2 * self.side**self.ndim
        return tiles * (8 * self.ndim + 5 + per_tile) + 8 * wide * per_tile

    def clear(self) -> None:
        """Forget all tiles."""
        self.arrays = self._empty(0, 0)

    def reserve(self, tiles: int, wide: int) -> None:
        """Make room for that many more tiles and wide rows.

        Raises:
            MapTooLargeError: this machine's memory would not hold the tiles twice while they grow.
        """
        self._reserve_rows(tiles, wide)
        slots = self.arrays.table.shape[0]
        while slots < 2 * (self.count + tiles):
            slots *= 2
        if slots > self.arrays.table.shape[0]:
            self.arrays = self.arrays._replace(table=np.full(slots, -1, np.int64))
            enter(self.arrays, 0)

    def _reserve_rows(self, tiles: int, wide: int) -> None:
        used, used_wide = self.count, int(self.arrays.counts[WIDE_COUNT])
        capacity, wide_capacity = self.arrays.coords.shape[0], self.arrays.wide.shape[0]
        if used + tiles <= capacity and used_wide + wide <= wide_capacity:
            return
        limit = memory_limit()
        if 2 * self.nbytes > limit:  # old and new lie side by side while the tiles are moved
            raise MapTooLargeError(
                f"the map has reached {self.nbytes / 1e9:.1f} GB in {used} tiles and must grow: "
                f"this machine's memory of {limit / 1e9:.1f} GB does not allow it; use a coarser "
                "resolution, or oddsmap.build_saved_map, which keeps parts of it on the disk"
            )
        if used + tiles > capacity:
            capacity = max(used + tiles, min(_GROWTH * capacity, limit // self._bytes(1, 0)))
        if used_wide + wide > wide_capacity:
            max_wide = limit // self._bytes(0, 1)
            wide_capacity = max(used_wide + wide, min(_GROWTH * wide_capacity, max_wide))
        try:
            old, new = self.arrays, self._empty(capacity, wide_capacity)
        except MemoryError:
            raise MapTooLargeError(
                f"no memory for {tiles} more tiles besides the {used} in use "
                f"({self._bytes(capacity, wide_capacity) / 1e9:.1f} GB): use a coarser resolution "
                "or crop"
            ) from None
        new.counts[:] = old.counts
        for name in ("coords", "load", "wide_of", "narrow"):
            getattr(new, name)[:used] = getattr(old, name)[:used]
        new.wide[:used_wide] = old.wide[:used_wide]
        self.arrays = new._replace(table=old.table)

    def units(self, slots: IntArray | slice) -> IntArray:
        """Weights in units of 1/65536 vote, shape (n, 2, cells of a tile): hits, passes."""
        units = self.arrays.narrow[slots].astype(np.int64) << FRACTION_BITS
        rows = self.arrays.wide_of[slots]
        units[rows >= 0] += self.arrays.wide[rows[rows >= 0]]
        return units

    def chunks(
        self, lo: IntArray | None = None, hi: IntArray | None = None
    ) -> Iterator[tuple[IntArray, IntArray]]:
        """The tiles, a few thousand at a time: coordinates (n, ndim) and units (n, 2, cells).

        Args:
            lo: only tiles from these coordinates on, shape (ndim,).
            hi: only tiles before these.
        """
        chosen = np.ones(self.count, np.bool_)
        if lo is not None:
            chosen &= (self.coords >= lo).all(axis=1)
        if hi is not None:
            chosen &= (self.coords < hi).all(axis=1)
        slots = np.flatnonzero(chosen)
        for start in range(0, len(slots), _CHUNK_TILES):
            part = slots[start : start + _CHUNK_TILES]
            yield self.arrays.coords[part], self.units(part)

    def census(self, slots: IntArray | None = None) -> Census:
        """What there is, in one pass over the tiles.

        Args:
            slots: which tiles, shape (n,); None: all.
        """
        which = np.arange(self.count) if slots is None else slots
        lo, hi = np.array([[_NOWHERE] * self.ndim, [-_NOWHERE] * self.ndim])
        totals = np.zeros(TOTALS, np.int64)
        take_census(self.arrays, which, self.side, lo, hi, totals)
        whole = totals.tolist()
        return Census(
            cells=whole[CELLS],
            hits=(whole[HIT_VOTES] << FRACTION_BITS) + whole[HIT_UNITS],
            passes=(whole[PASS_VOTES] << FRACTION_BITS) + whole[PASS_UNITS],
            largest=whole[LARGEST],
            whole_votes=whole[FRACTION] == 0,
            bounds=(lo, hi) if whole[CELLS] else None,
        )

    def cells(self) -> tuple[IntArray, IntArray, IntArray]:
        """The cells with a weight in order of their index, x changing fastest.

        Returns:
            index, shape (n, ndim), x first; units of hits and passes, shape (n,) each.
        """
        for whole in self.parts(self.census().cells):
            return whole
        nothing = np.empty(0, np.int64)
        return np.empty((0, self.ndim), np.int64), nothing, nothing

    def parts(
        self,
        most: int = PART,
        *,
        last_axis: tuple[int, int] | None = None,
        within: Region | None = None,
    ) -> Iterator[tuple[IntArray, IntArray, IntArray]]:
        """As `cells`, some cells at a time.

        Args:
            most: how many, and no more than a row of cells beyond that.
            last_axis: only tiles with cells from the first of these indices on and before the
                second, along the last axis.
            within: only tiles with cells of this box, (lo, hi), hi past the last.
        """
        coords = self.coords
        order = np.lexsort(coords.T)
        if last_axis is not None:
            first, past = last_axis[0] // self.side, -(-last_axis[1] // self.side)
            order = order[(coords[order, -1] >= first) & (coords[order, -1] < past)]
        if within is not None:
            lo, hi = (np.asarray(end, np.int64) for end in within)
            near = (coords >= lo // self.side) & (coords < -(-hi // self.side))
            order = order[np.all(near, axis=1)[order]]
        if len(order) == 0:
            return
        # Where another row of tiles begins.
        begin = (np.diff(coords[order, 1:], axis=0) != 0).any(axis=1)
        rows = np.concatenate([[0], np.flatnonzero(begin) + 1, [len(order)]]).astype(np.int64)
        room = most + self.side * int(np.diff(rows).max())
        narrow = self.arrays.narrow
        words = narrow.view(np.uint64) if self.side % 8 == 0 else np.empty((0, 2, 0), np.uint64)
        at = np.zeros(1, np.int64)
        while at[0] >= 0:
            index = np.empty((room, self.ndim), np.int64)
            hits, passes = np.empty(room, np.int64), np.empty(room, np.int64)
            found = list_cells(self.arrays, self.side, order, rows, words, at, index, hits, passes)
            if found:
                yield index[:found], hits[:found], passes[:found]

    def region(self, lo: IntArray, hi: IntArray) -> IntArray:
        """Units of a box of cells, shape (2, ny, nx) or (2, nz, ny, nx): hits, passes."""
        side, d = self.side, self.ndim
        tile_lo, tile_hi = lo // side, -(-hi // side)
        span = (tile_hi - tile_lo)[::-1]
        # Seen as tiles of cells, (2, ty, side, tx, side), whole tiles are put in place at once.
        full = np.zeros((2, *(n for count in span for n in (int(count), side))), np.int64)
        slots = np.flatnonzero(((self.coords >= tile_lo) & (self.coords < tile_hi)).all(axis=1))
        at = (self.coords[slots] - tile_lo)[:, ::-1]
        where = [part for axis in range(d) for part in (at[:, axis], slice(None))]
        full[(slice(None), *where)] = self.units(slots).reshape(-1, 2, *(side,) * d)
        begin, end = (lo - tile_lo * side)[::-1], (hi - tile_lo * side)[::-1]
        cut = tuple(slice(a, b) for a, b in zip(begin, end, strict=True))
        return full.reshape(2, *(span * side))[(slice(None), *cut)].copy()

    def at(self, index: IntArray) -> tuple[IntArray, IntArray]:
        """Units of hits and passes of single cells, shape (n,) each; index has shape (n, ndim)."""
        hits, passes = np.empty((2, len(index)), np.int64)
        key = np.zeros(self.ndim, np.int64)
        look_up(self.arrays, self.side, np.ascontiguousarray(index), key, hits, passes)
        return hits, passes

    def add_cells(self, index: IntArray, units: IntArray) -> None:
        """Add weights to single cells; errors as in `add`.

        Args:
            index: cells, shape (n, ndim), x first; what is given for one cell adds up.
            units: non-negative weights in 1/65536 vote, shape (n, 2): hits, passes.
        """
        if len(index) == 0:
            return
        side, d = self.side, self.ndim
        coords, tile = distinct_rows(index // side)
        within = np.ravel_multi_index(tuple((index % side).T[::-1]), (side,) * d)
        # Flat, which NumPy adds at twice as fast as at three indices.
        at = 2 * side**d * tile[:, None] + side**d * np.arange(2) + within[:, None]
        if units.sum(dtype=np.float64) > MAX_UNITS:  # a cell's own sum might not fit int64
            totals = np.zeros(len(coords) * 2 * side**d)
            np.add.at(totals, at.ravel(), units.ravel().astype(np.float64))
            self._check_sum(int(totals.max()))
        whole = np.zeros(len(coords) * 2 * side**d, np.int64)
        np.add.at(whole, at.ravel(), units.ravel().astype(np.int64))
        self.add(coords, whole.reshape(-1, 2, side**d))

    def add(self, coords: IntArray, units: IntArray) -> None:
        """Add weights to tiles; new tiles are made.

        Args:
            coords: tile coordinates, shape (n, ndim), each at most once.
            units: non-negative weights in 1/65536 vote, shape (n, 2, cells of a tile).

        Raises:
            MapTooLargeError: a cell's weight might pass 2^62 units; nothing has been added.
        """
        self._check_sum(int(units.max(initial=0)))
        self.fill(coords, units)

    def fill(self, coords: IntArray, units: IntArray) -> None:
        """As `add`, without looking at the limit: for tiles of which there are none yet.

        Args:
            coords: as in `add`.
            units: likewise, none above `HEAVIEST`.

        Raises:
            MapTooLargeError: no memory for the tiles; nothing has been added.
        """
        self.reserve(len(coords), len(coords))
        add_tiles(self.arrays, np.ascontiguousarray(coords), np.ascontiguousarray(units))

    def merge(self, other: TileStore) -> None:
        """Add all tiles of another store with the same side; errors as in `add`."""
        self._check_sum(other._max_weight())
        # A list of parts first: a store added to itself must not change while it is read.
        parts = other.chunks() if other is not self else list(other.chunks())
        for coords, units in parts:
            self.add(coords, units)

    def _check_sum(self, more: int) -> None:
        if more + self._max_weight() > MAX_UNITS:
            raise MapTooLargeError(
                "a cell's weight would pass 2^46 votes (2^62 units): "
                "the same evidence has been added many times over"
            )

    def _max_weight(self) -> int:
        if self.count == 0:
            return 0
        # An upper bound is enough here, and cheap: the narrow level holds at most 255 votes.
        wide = self.arrays.wide[: int(self.arrays.counts[WIDE_COUNT])]
        return (int(wide.max()) if wide.size else 0) + (255 << FRACTION_BITS)


def distinct_rows(rows: IntArray) -> tuple[IntArray, IntArray]:
    """The distinct rows of whole numbers, and which of them each row is, shape (n,).

    As one number a row, which sorts ten times as fast as rows do, where there is such a number.
    """
    lo = rows.min(axis=0)
    spans = [int(n) + 1 for n in rows.max(axis=0) - lo]
    if math.prod(spans) >= 1 << 62:
        distinct, which = np.unique(rows, axis=0, return_inverse=True)
        return distinct, which.ravel()
    keys, which = np.unique(np.ravel_multi_index(tuple((rows - lo).T), spans), return_inverse=True)
    return np.stack(np.unravel_index(keys, spans), axis=1).astype(np.int64) + lo, which
