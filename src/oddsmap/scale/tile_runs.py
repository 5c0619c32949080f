# SPDX-License-Identifier: Apache-2.0
"""Partial sums of a map on the disk: tiles that made room for others, shard by shard.

Each time that memory is full all its tiles are written as one run, and forgotten. Evidence adds up
exactly and in any order, so no tile has to come back while the map is built: what the map holds in
a shard is the sum of what all runs hold there.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import OutputError
from oddsmap.evidence.tile_rows import TileRows, add_rows, rows_of
from oddsmap.evidence.tiles import TileStore
from oddsmap.map_files.side_by_side import do_side_by_side
from oddsmap.map_files.zarr_folder import SHARD

__all__ = ["TileRuns"]

# Of compression: zstd's quickest of those that find repetitions. What is written is read once.
_LEVEL = 1

Place = tuple[int, ...]
"""Of a shard, in shards from cell 0, x first."""


class _Entry(NamedTuple):
    """The tiles of one shard in one run: where in the file, and how many."""

    at: int
    length: int
    tiles: int
    wide: int


class TileRuns:
    """A file of runs.

    Args:
        file: to be made, in a folder of its own that somebody else removes.
        ndim: 2 or 3.
        side: cells along a tile's side, which divides a shard's.
        output: the map that is being built, for messages.
    """

    def __init__(self, file: Path, ndim: int, side: int, output: Path) -> None:
        self._file, self._ndim, self._side, self._output = file, ndim, side, output
        self._across = SHARD[ndim] // side
        self._index: dict[Place, list[_Entry]] = {}
        self._lock = threading.Lock()
        self.bytes_written = 0
        self.run_count = 0

    def places(self) -> list[Place]:
        """The shards of which runs hold something."""
        return list(self._index)

    def write(self, tiles: TileStore) -> None:
        """Write all tiles of a store as a run; threads may write several.

        Raises:
            OutputError: the disk is full, or failed.
        """
        try:
            do_side_by_side(lambda group: self._write_group(tiles, group), self._groups(tiles))
        except OSError as error:
            raise OutputError(
                f"{self._output}: evidence beyond --memory (memory=) is kept beside it while it is "
                f"built, and that cannot be written: {error.strerror or error}; free some disk, "
                "or let the map take more memory"
            ) from error
        with self._lock:
            self.run_count += 1

    def _groups(self, tiles: TileStore) -> Iterator[IntArray]:
        """The tiles of each shard."""
        places = tiles.coords // self._across
        order = np.lexsort(places.T)
        another = (np.diff(places[order], axis=0) != 0).any(axis=1)
        for group in np.split(order, np.flatnonzero(another) + 1):
            if len(group):
                yield group

    def _write_group(self, tiles: TileStore, group: IntArray) -> None:
        from numcodecs.zstd import compress

        rows = rows_of(tiles, group)
        place = rows.coords[0] // self._across
        within = (rows.coords - place * self._across)[:, ::-1]
        number = np.ravel_multi_index(tuple(within.T), (self._across,) * self._ndim)
        parts = (number.astype("<i4"), rows.load, rows.narrow, rows.wide_at.astype("<i4"),
                 rows.wide.astype("<i8", copy=False))  # fmt: skip
        frame = compress(b"".join(part.tobytes() for part in parts), _LEVEL, True)
        with self._lock:
            self._append(frame)
            entry = _Entry(self.bytes_written, len(frame), len(group), len(rows.wide_at))
            self.bytes_written += len(frame)
            self._index.setdefault(tuple(place.tolist()), []).append(entry)

    def _append(self, frame: bytes) -> None:
        with self._file.open("ab") as file:
            file.write(frame)

    def read(self, place: Place) -> TileStore:
        """The sum of what the runs hold in a shard.

        Raises:
            OutputError: the file is gone, or damaged.
            MapTooLargeError: a cell would pass 2^46 votes.
        """
        tiles = TileStore(self._ndim, self._side)
        slot_of = np.full(self._across**self._ndim, -1, np.int64)
        for entry in self._index.get(place, ()):
            number, rows = self._read(place, entry)
            slots = slot_of[number]
            add_rows(tiles, rows, slots)
            slot_of[number] = slots
        return tiles

    def _read(self, place: Place, entry: _Entry) -> tuple[IntArray, TileRows]:
        from numcodecs.zstd import decompress

        cells = 2 * self._side**self._ndim
        sizes = [4 * entry.tiles, entry.tiles, cells * entry.tiles, 4 * entry.wide]
        content = np.empty(sum(sizes) + 8 * cells * entry.wide, np.uint8)
        try:
            with self._file.open("rb") as file:
                file.seek(entry.at)
                decompress(file.read(entry.length), content)
        except (OSError, RuntimeError, ValueError) as error:
            raise OutputError(
                f"{self._output}: the evidence that was kept beside it while it was built cannot "
                f"be read back ({' '.join(str(error).split())}): build it again"
            ) from None
        numbers, load, narrow, wide_at, wide = np.split(content, np.cumsum(sizes))
        number = numbers.view("<i4").astype(np.int64)
        within = np.stack(np.unravel_index(number, (self._across,) * self._ndim)[::-1], axis=1)
        shape = (-1, 2, cells // 2)
        # Not a view where it may begin anywhere: 64 bits want to be aligned.
        wide_units = np.frombuffer(wide.tobytes(), "<i8").astype(np.int64, copy=False)
        return number, TileRows(
            within + np.array(place, np.int64) * self._across,
            load,
            narrow.reshape(shape),
            np.frombuffer(wide_at.tobytes(), "<i4").astype(np.int64),
            wide_units.reshape(shape),
        )
