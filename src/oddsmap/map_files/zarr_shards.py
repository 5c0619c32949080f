# SPDX-License-Identifier: Apache-2.0
"""The shards of a saved map: which there are, and their cells."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.map_files.shard_bytes import shard_checksum, shard_index, unpack_chunk
from oddsmap.map_files.zarr_folder import CHUNK, CHUNKS_IN_SHARD, SHARD, shard_files
from oddsmap.map_files.zarr_header import Header

__all__ = ["SavedChunks", "SavedShards"]


class SavedChunks(NamedTuple):
    """Some chunks of a shard, unpacked."""

    first: IntArray
    """The first cell of each, shape (n, d), x first."""
    cells: list[npt.NDArray[Any]]
    """Of each array that was asked for, shape (n, chunk^d), x fastest; the fill value where a chunk
    is written in another array alone."""


class SavedShards:
    """The shards of a map's arrays.

    Args:
        path: the map's folder.
        header: what it says of itself.
    """

    def __init__(self, path: Path, header: Header) -> None:
        self.path, self.header = path, header
        self.ndim = len(header.shape)

    def places(self, names: Iterable[str]) -> list[tuple[int, ...]]:
        """Where any of some arrays has a file, in shards, z before y before x, in order.

        Files that are not listed count as well: another process may have added them.

        Raises:
            ValueError: a file that was written is missing, or one lies outside the arrays.
        """
        found: set[tuple[int, ...]] = set()
        for name in names:
            files = {tuple(place) for place in shard_files(self.path, name, self.ndim)}
            # To Zarr a missing file is a shard of zeros; here it would be cells lost silently.
            missing = [place for place in self.header.shards[name] if place not in files]
            if missing:
                raise ValueError(f"{self._file(name, missing[0])} is missing or empty")
            found |= files
        grid = tuple(n // SHARD[self.ndim] for n in self.header.shape)
        for place in found:
            if any(i >= n for i, n in zip(place, grid, strict=True)):
                raise ValueError(f"a file of shard {place} lies outside the map")
        return sorted(found)

    def read_all(
        self,
        names: Sequence[str],
        lo: IntArray | None = None,
        hi: IntArray | None = None,
        places: Sequence[tuple[int, ...]] | None = None,
    ) -> Iterator[SavedChunks]:
        """Read shard after shard, by default all; arguments and errors as of `read` and `places`.

        In one thread: unpacking a chunk takes 30 us, and two threads that wait for Python's lock so
        often took 1.4 times the CPU time for the same wall time.
        """
        side = SHARD[self.ndim]
        for place in self.places(names) if places is None else self._checked(names, places):
            begin = self._begin(place)
            if lo is not None and (begin + side <= lo).any():
                continue
            if hi is not None and (begin >= hi).any():
                continue
            yield self.read(names, place, lo, hi)

    def read(
        self,
        names: Sequence[str],
        place: tuple[int, ...],
        lo: IntArray | None = None,
        hi: IntArray | None = None,
    ) -> SavedChunks:
        """The chunks of a shard that are written in any of some arrays.

        Args:
            names: of the arrays.
            place: of the shard, in shards, z before y before x.
            lo: only chunks with a cell from this one on, shape (d,), x first.
            hi: only chunks with a cell before this one.

        Raises:
            ValueError: it is damaged.
        """
        d = self.ndim
        chunk, grid = CHUNK[d], SHARD[d] // CHUNK[d]
        frames = [self._frames(name, place) for name in names]
        numbers = np.array(sorted(set().union(*frames)), np.int64)
        at = np.stack(np.unravel_index(numbers, (grid,) * d)[::-1], axis=1)
        first = self._begin(place) + at * chunk
        chosen = np.ones(len(numbers), np.bool_)
        if lo is not None:
            chosen &= (first + chunk > lo).all(axis=1)
        if hi is not None:
            chosen &= (first < hi).all(axis=1)
        numbers, first = numbers[chosen], first[chosen]
        cells = []
        for name, own in zip(names, frames, strict=True):
            array = self.header.arrays[name]
            found = np.empty((len(numbers), chunk**d), array.dtype)
            file = self._file(name, place)
            for row, number in zip(found, numbers.tolist(), strict=True):
                if number in own:
                    unpack_chunk(own[number], row, file)
                else:
                    row[:] = array.fill_value
            cells.append(found)
        return SavedChunks(first, cells)

    def _frames(self, name: str, place: tuple[int, ...]) -> dict[int, bytes]:
        """The written chunks of a shard of one array, packed, by their numbers."""
        file = self.path / self._file(name, place)
        if not file.exists():
            return {}
        d, dtype = self.ndim, self.header.arrays[name].dtype
        # What cannot be packed is hardly longer.
        if file.stat().st_size > 2 * SHARD[d] ** d * dtype.itemsize:
            raise ValueError(f"{self._file(name, place)} is larger than its cells")
        count = CHUNKS_IN_SHARD[d]
        content = file.read_bytes()
        frames = shard_index(content, count, self._file(name, place))
        checksum = self.header.checksums.get(name, {}).get(place)
        if checksum is not None and shard_checksum(content, count) != checksum:
            raise ValueError(
                f"{self._file(name, place)} is not what was saved, but another map's or another "
                "save's (attribute checksums; set digest to null if you have edited the map)"
            )
        return frames

    def _checked(
        self, names: Sequence[str], places: Sequence[tuple[int, ...]]
    ) -> Iterator[tuple[int, ...]]:
        """Some places, each once none of its files is missing."""
        listed = {name: set(self.header.shards[name]) for name in names}
        for place in places:
            for name in names:
                file = self.path / self._file(name, place)
                if place in listed[name] and not (file.is_file() and file.stat().st_size):
                    raise ValueError(f"{self._file(name, place)} is missing or empty")
            yield place

    def _begin(self, place: tuple[int, ...]) -> IntArray:
        """The first cell of a shard, x first."""
        cells: IntArray = np.array(place[::-1], np.int64) * SHARD[self.ndim]
        return cells + self.header.origin_cell

    def _file(self, name: str, place: tuple[int, ...]) -> str:
        return f"{name}/c/{'/'.join(map(str, place))}"
