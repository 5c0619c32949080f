# SPDX-License-Identifier: Apache-2.0
"""Tiles that make room for others before they take more memory than they may."""

from __future__ import annotations

import weakref
from collections.abc import Callable

from oddsmap.errors import MapTooLargeError
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.vote.tiles import WIDE_COUNT
from oddsmap.limits import memory_limit

__all__ = ["Budget", "SpillingTiles"]

# Of the hash table, for each tile: two to four slots of 8 bytes.
_TABLE_BYTES = 32
# Where rows run out 8 times as many are made, and from a 64th of the share on as many as it allows:
# no more than an eighth of it is ever moved, and lies in memory twice meanwhile.
_GROWTH, _FEW = 8, 64


class Budget:
    """Memory that stores of tiles share, by equal parts.

    Args:
        memory: bytes of tiles, of all stores together.
    """

    def __init__(self, memory: int) -> None:
        self._memory = memory
        self._stores: weakref.WeakSet[SpillingTiles] = weakref.WeakSet()
        self.most = 0
        """The most bytes of tiles that there were at once, as far as they were counted."""

    def join(self, tiles: SpillingTiles) -> None:
        """Count one more store; those that are gone count no more."""
        self._stores.add(tiles)

    @property
    def share(self) -> int:
        """Bytes that each store may take."""
        return self._memory // max(1, len(self._stores))

    def count(self) -> None:
        """Note how many bytes there are now."""
        self.most = max(self.most, sum(tiles.nbytes for tiles in list(self._stores)))


class SpillingTiles(TileStore):
    """Tiles of which all that there are go elsewhere where more would pass a share of memory.

    What one scan needs it gets, also where that is more than the share.

    Args:
        ndim: 2 or 3.
        side: cells along a tile's side.
        spill: takes what is in a store, which is emptied afterwards.
        budget: which memory it has a share of.
    """

    def __init__(
        self, ndim: int, side: int, spill: Callable[[TileStore], None], budget: Budget
    ) -> None:
        super().__init__(ndim, side)
        self._spill, self._budget = spill, budget
        self._whole = self.arrays
        self._has_spilled = False
        budget.join(self)

    def like(self) -> SpillingTiles:
        """An empty store of the same shape, which spills to the same place."""
        return SpillingTiles(self.ndim, self.side, self._spill, self._budget)

    def clear(self) -> None:
        """Forget all tiles, and give their memory back."""
        super().clear()
        self._whole = self.arrays

    def spill(self) -> None:
        """Send all tiles away."""
        if self.count:
            self._budget.count()
            self._spill(self)
            self.clear()
            self._has_spilled = True

    def reserve(self, tiles: int, wide: int) -> None:
        """As `TileStore.reserve`; what is there is sent away where it would be too much."""
        if self._expected(tiles, wide) > self._budget.share:
            self.spill()
        super().reserve(tiles, wide)

    def _expected(self, tiles: int, wide: int) -> int:
        """Bytes once so many more tiles and wide rows may have come.

        Wide rows are asked for in case that all tiles need one; as many are expected as there are
        of those that have come. A scan for which that was too few is made good before the next.
        """
        rows, wide_rows = self._used()
        return self._cost(rows + tiles, wide_rows + wide * wide_rows // max(1, rows))

    def _used(self) -> tuple[int, int]:
        return self.count, int(self.arrays.counts[WIDE_COUNT])

    def _cost(self, tiles: int, wide: int) -> int:
        return self._bytes(tiles, wide) + _TABLE_BYTES * tiles

    def _reserve_rows(self, tiles: int, wide: int) -> None:
        """Let kernels use as many rows as there is memory for, of rows that are only addresses.

        Kernels ask when rows run out, and narrow and wide ones have their memory in common: of what
        is left each gets a half, until too little is left.
        """
        self._make(tiles, wide)
        rows, wide_rows = (n + more for n, more in zip(self._used(), (tiles, wide), strict=True))
        left = max(0, self._budget.share - self._expected(tiles, wide)) // 2
        rows += left // self._cost(1, 0)
        wide_rows += left // self._cost(0, 1)
        whole = self._whole
        self.arrays = whole._replace(
            table=self.arrays.table, coords=whole.coords[:rows], load=whole.load[:rows],
            wide_of=whole.wide_of[:rows], narrow=whole.narrow[:rows], wide=whole.wide[:wide_rows],
        )  # fmt: skip

    def _make(self, tiles: int, wide: int) -> None:
        """Make rows, mostly of addresses alone, where those that are asked for are not there."""
        capacity, wide_capacity = len(self._whole.coords), len(self._whole.wide)
        used, used_wide = self._used()
        if used + tiles <= capacity and used_wide + wide <= wide_capacity:
            return
        limit = memory_limit()
        if self._bytes(used + tiles, used_wide) > limit:
            raise MapTooLargeError(
                f"one scan needs {self._bytes(tiles, 0) / 1e9:.1f} GB of tiles, more than this "
                f"machine's memory of {limit / 1e9:.1f} GB: use a coarser resolution, or range_max"
            )
        if used + tiles > capacity:
            capacity = self._next(capacity, used + tiles, self._cost(1, 0))
        if used_wide + wide > wide_capacity:
            wide_capacity = self._next(wide_capacity, used_wide + wide, self._cost(0, 1))
        try:
            old, new = self._whole, self._empty(capacity, wide_capacity)
        except MemoryError:
            raise MapTooLargeError(
                f"no memory for {tiles} more tiles besides the {used} in use: give the map less "
                "with --memory (memory=)"
            ) from None
        new.counts[:] = old.counts
        for name in ("coords", "load", "wide_of", "narrow"):
            getattr(new, name)[:used] = getattr(old, name)[:used]
        new.wide[:used_wide] = old.wide[:used_wide]
        self._whole = new

    def _next(self, capacity: int, needed: int, row_bytes: int) -> int:
        """How many rows to make: few at first."""
        share = self._budget.share
        few = _FEW * capacity * self._cost(1, 1) <= share and not self._has_spilled
        return max(needed, _GROWTH * capacity if few else share // row_bytes)
