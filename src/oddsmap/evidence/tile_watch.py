# SPDX-License-Identifier: Apache-2.0
"""Which tiles have other weights than they had: found by comparing them with a copy."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, IntArray, Region
from oddsmap.evidence.tiles import TileStore

__all__ = ["TileWatch"]

_CHUNK = 4096
"""Tiles compared at a time."""


class TileWatch:
    """A copy of tiles, to find out where a store has changed.

    Args:
        tiles: the store.
        within: the box of cells to watch, (lo, hi), hi past the last; None: all.
    """

    def __init__(self, tiles: TileStore, within: Region | None) -> None:
        self._within = within
        self._take(tiles)

    def _take(self, tiles: TileStore) -> None:
        self._tiles, self._count, self._slots = tiles, tiles.count, self._chosen(tiles, 0)
        arrays = tiles.arrays
        self._coords = arrays.coords[self._slots]
        self._narrow, self._wide_of = arrays.narrow[self._slots], arrays.wide_of[self._slots]
        self._wide = arrays.wide[self._wide_of[self._wide_of >= 0]]

    def _chosen(self, tiles: TileStore, start: int) -> IntArray:
        """The watched tiles from a slot on."""
        coords = tiles.coords[start:]
        if self._within is None:
            return np.arange(start, start + len(coords))
        lo, hi = (np.asarray(end, np.int64) for end in self._within)
        near = (coords >= lo // tiles.side) & (coords < -(-hi // tiles.side))
        return start + np.flatnonzero(near.all(axis=1))

    def changed(self, tiles: TileStore) -> Region | None:
        """The box of cells outside which no watched tile has changed since this was last asked.

        Args:
            tiles: the store.

        Returns:
            (lo, hi), hi past the last, the same twice where nothing has changed; None: it is
            another store, or has lost tiles.
        """
        arrays, slots = tiles.arrays, self._slots
        if tiles is not self._tiles or tiles.count < self._count:
            return None
        if not np.array_equal(arrays.coords[slots], self._coords):
            return None
        differ = np.flatnonzero(self._differing(tiles))
        new = self._chosen(tiles, self._count)
        changed = np.concatenate([self._coords[differ], arrays.coords[new]])
        if len(changed) == 0:
            return (np.zeros(tiles.ndim, np.int64),) * 2
        if len(new) or (arrays.wide_of[slots[differ]] >= 0).any():
            self._take(tiles)
        else:
            self._narrow[differ] = arrays.narrow[slots[differ]]
        return changed.min(axis=0) * tiles.side, (changed.max(axis=0) + 1) * tiles.side

    def _differing(self, tiles: TileStore) -> BoolArray:
        arrays, slots = tiles.arrays, self._slots
        differ: BoolArray = arrays.wide_of[slots] != self._wide_of
        for start in range(0, len(slots), _CHUNK):
            part = slice(start, start + _CHUNK)
            rows = slots[part]
            # Tiles that lie side by side need not be copied to be looked at.
            whole = self._within is None
            now = arrays.narrow[slice(rows[0], rows[-1] + 1) if whole else rows]
            differ[part] |= (_words(now) != _words(self._narrow[part])).any(axis=1)
        wide = np.flatnonzero((self._wide_of >= 0) & ~differ)
        if len(wide):
            row = np.cumsum(self._wide_of >= 0) - 1
            other = arrays.wide[self._wide_of[wide]] != self._wide[row[wide]]
            differ[wide] = other.any(axis=(1, 2))
        return differ


def _words(narrow: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
    """The bytes of each tile, eight at a time where they can be."""
    rows = narrow.reshape(len(narrow), -1)
    return rows.view(np.uint64) if rows.shape[1] % 8 == 0 else rows
