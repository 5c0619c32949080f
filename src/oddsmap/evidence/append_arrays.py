# SPDX-License-Identifier: Apache-2.0
"""The arrays of a saved map that is added to: shards that are written, and those that stay."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.store import _LENGTHS, _VOTES, _check_counts, _unit_of
from oddsmap.evidence.tile_counts import append_counts, counts_of, retiled
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import HITS, ONE, PASSES
from oddsmap.limits import TILE_SIDE
from oddsmap.map_files.chunk_blocks import (
    ShardBlocks,
    block_coords,
    blocks_by_shard,
    blocks_from_chunks,
    used_blocks,
)
from oddsmap.map_files.side_by_side import do_side_by_side
from oddsmap.map_files.zarr_folder import CHUNK, SHARD, NewFolder
from oddsmap.map_files.zarr_header import Header
from oddsmap.map_files.zarr_shards import SavedChunks, SavedShards
from oddsmap.map_files.zarr_snapshot import read_unchanged

__all__ = [
    "Place",
    "ShardFiles",
    "StoredTiles",
    "UntouchedShards",
    "reached_shards",
    "stored_tiles",
]

Place = tuple[int, ...]
"""Of a shard, in shards, z before y before x."""


class ShardFiles(Protocol):
    """What shards are written to: see `NewFolder`."""

    def create(
        self,
        name: str,
        dtype: npt.DTypeLike,
        fill_value: float,
        attributes: Mapping[str, Any],
    ) -> None:
        """Make an array."""

    def write(self, name: str, place: Place, numbers: IntArray, chunks: npt.NDArray[Any]) -> None:
        """Write a shard of it."""


class StoredTiles(NamedTuple):
    """Tiles, and the arrays that they are saved in."""

    tiles: TileStore
    channels: tuple[int, ...]
    """What each array has of the tiles: HITS or PASSES."""
    texts: dict[str, str]
    """What each array is, by its name."""

    @property
    def names(self) -> list[str]:
        """Of the arrays."""
        return list(self.texts)

    def reached(self) -> IntArray:
        """The shards with a tile, counted from cell 0, shape (n, d), x first."""
        tiles, side = self.tiles, SHARD[self.tiles.ndim]
        # Only a caller's own tiles reach over a shard.
        fitting = tiles if side % tiles.side == 0 else retiled(tiles, TILE_SIDE[tiles.ndim])
        return np.unique(fitting.coords * fitting.side // side, axis=0)

    def read(self, shards: SavedShards, place: Place) -> None:
        """Add what a saved shard holds to the tiles, which have none of it yet.

        Raises:
            ValueError: it is damaged.
        """
        self.fill(shards.read(self.names, place), _units_in(shards.header, self.names[0]))

    def fill(self, chunks: SavedChunks, unit: int) -> None:
        """Add the cells of chunks, in counts of a unit; errors and what must not be there as above.

        Args:
            chunks: of each of the arrays.
            unit: units in one count.
        """
        tiles, d, side = self.tiles, self.tiles.ndim, self.tiles.side
        for cells, name in zip(chunks.cells, self.names, strict=True):
            _check_counts(cells, unit, name)
        some = np.flatnonzero(np.any([used_blocks(c, side, d) for c in chunks.cells], axis=0))
        counts = [blocks_from_chunks(cells, side, d, some) for cells in chunks.cells]
        # Lengths are stored in place of passes.
        hits, passes = counts if len(counts) == 2 else (np.zeros_like(counts[0]), counts[0])
        append_counts(tiles, block_coords(chunks.first, side, some), hits, passes, unit)

    def form(self, header: Header) -> tuple[int, np.dtype[Any], str | None]:
        """The unit and the type of arrays that something was added to; why they are others."""
        array, census = header.arrays[self.names[0]], self.tiles.census()
        before = _units_in(header, self.names[0])
        unit = ONE if before == ONE and census.whole_votes else 1
        # Of the votes that were whole 65536 times as many units: 16 bits more.
        units = np.dtype(np.uint32 if array.dtype.itemsize <= 2 else np.uint64)
        kept = array.dtype if unit == before else units
        needed = np.min_scalar_type(census.largest // unit)
        dtype = needed if needed.itemsize > kept.itemsize else kept
        if unit != before:
            return unit, dtype, "parts of votes were added to whole votes"
        if dtype != array.dtype:
            return unit, dtype, f"a count passed what {array.dtype} holds"
        return unit, dtype, None

    def write(
        self, folder: ShardFiles, first_place: IntArray, unit: int, dtype: np.dtype[Any]
    ) -> None:
        """Make the arrays, with all shards that have a tile.

        Args:
            folder: the new map's.
            first_place: the first shard of its arrays, counted from cell 0, shape (d,), x first.
            unit: units in one count.
            dtype: of the counts.
        """
        for name, text in self.texts.items():
            folder.create(name, dtype, 0, {"description": text, "weight_unit": unit / ONE})
        tiles, d = self.tiles, self.tiles.ndim
        fitting = tiles if CHUNK[d] % tiles.side == 0 else retiled(tiles, TILE_SIDE[d])

        def write(shard: ShardBlocks) -> None:
            place = tuple((shard.place - first_place)[::-1].tolist())
            for name, channel in zip(self.names, self.channels, strict=True):
                counts = counts_of(fitting, shard.blocks, channel, unit, dtype)
                chunks = shard.to_chunks(counts, fitting.side)
                folder.write(name, place, shard.numbers, chunks)

        do_side_by_side(write, blocks_by_shard(fitting.coords, fitting.side))


def stored_tiles(evidence: Evidence) -> list[StoredTiles]:
    """All tiles of a map: votes, and lengths where it keeps them."""
    stored = [StoredTiles(evidence.tiles, (HITS, PASSES), _VOTES)]
    if evidence.lengths is not None:
        stored.append(StoredTiles(evidence.lengths, (PASSES,), _LENGTHS))
    return stored


def _units_in(header: Header, name: str) -> int:
    """Units in one count of an array."""
    return _unit_of(header.arrays[name].attributes, name)


def reached_shards(evidence: Evidence) -> IntArray:
    """The shards that evidence lies in, counted from cell 0, shape (n, d), x first."""
    return np.unique(
        np.concatenate([stored.reached() for stored in stored_tiles(evidence)]), axis=0
    )


class UntouchedShards(NamedTuple):
    """The shards of an array that nothing was added to, on their way to the new map."""

    path: Path
    """Of the old map."""
    header: Header
    name: str
    shift: IntArray
    """How much further a place is in the new map, in shards, z before y before x."""

    def moved(self, place: Place) -> Place:
        """A place in the new map's arrays."""
        return tuple((np.array(place) + self.shift).tolist())

    def link(self, place: Place, folder: NewFolder) -> bool:
        """Take a shard as it is; False where it had to be copied.

        Raises:
            InputError: it is gone.
        """
        file = self.path.joinpath(self.name, "c", *map(str, place))
        try:
            checksum = self.header.checksums.get(self.name, {}).get(place)
            return folder.take_over(self.name, self.moved(place), file, checksum)
        except FileNotFoundError:
            raise InputError(f"{file}: is missing, and belongs to the map") from None

    def write_anew(self, place: Place, folder: NewFolder, unit: int, dtype: np.dtype[Any]) -> None:
        """Write a shard in another unit or type.

        Raises:
            InputError: it is damaged.
        """
        name, d = self.name, len(place)
        before = _units_in(self.header, name)

        def read() -> tuple[IntArray, Any]:
            chunks = SavedShards(self.path, self.header).read([name], place)
            _check_counts(chunks.cells[0], before, name)
            at = chunks.first - self.header.origin_cell - np.array(place[::-1]) * SHARD[d]
            across = SHARD[d] // CHUNK[d]
            return (at // CHUNK[d] * across ** np.arange(d)).sum(axis=1), chunks.cells[0]

        numbers, cells = read_unchanged(self.path, read)
        counts = cells.astype(dtype) * dtype.type(before // unit)
        folder.write(name, self.moved(place), numbers, counts)
