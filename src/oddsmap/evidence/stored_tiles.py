# SPDX-License-Identifier: Apache-2.0
"""The tiles of a map and the arrays that they are saved in, shard by shard, both ways."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tile_counts import append_counts, counts_of, retiled
from oddsmap.evidence.tiles import HEAVIEST, Census, TileStore
from oddsmap.kernels.units import HITS, ONE, PASSES
from oddsmap.limits import TILE_SIDE
from oddsmap.map_files.chunk_blocks import (
    ShardBlocks,
    block_coords,
    blocks_by_shard,
    blocks_from_chunks,
    clear_outside,
    used_blocks,
)
from oddsmap.map_files.zarr_folder import CHUNK, SHARD
from oddsmap.map_files.zarr_header import Header
from oddsmap.map_files.zarr_shards import SavedChunks

__all__ = [
    "LENGTHS", "VOTES", "Form", "Place", "ShardFiles", "StoredShard", "StoredTiles", "check_counts",
    "reached_shards", "stored_tiles", "unit_of",
]  # fmt: skip

VOTES = {
    "hits": "weight of the readings that ended in the cell [weight_unit votes]",
    "passes": "weight of the readings that went through it [weight_unit votes]",
}
"""What the arrays of votes are, by their names."""
LENGTHS = {"lengths": "length of the beams inside the cell [weight_unit sides of a cell]"}

Place = tuple[int, ...]
"""Of a shard, in shards, z before y before x."""


class Form(NamedTuple):
    """How tiles are stored."""

    unit: int
    """Units of 1/65536 in one count."""
    dtype: np.dtype[Any]
    """Of the counts."""

    @classmethod
    def narrowest(cls, census: Census) -> Form:
        """Whole votes where all are, and the narrowest type that holds the largest."""
        unit = ONE if census.whole_votes else 1
        return cls(unit, np.min_scalar_type(census.largest // unit))


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

    def unit_in(self, header: Header) -> int:
        """Units in one count of the arrays of a saved map."""
        name = self.names[0]
        return unit_of(header.arrays[name].attributes, name)

    def reached(self) -> IntArray:
        """The shards with a tile, counted from cell 0, shape (n, d), x first."""
        tiles, side = self.tiles, SHARD[self.tiles.ndim]
        # Only a caller's own tiles reach over a shard.
        fitting = tiles if side % tiles.side == 0 else retiled(tiles, TILE_SIDE[tiles.ndim])
        return np.unique(fitting.coords * fitting.side // side, axis=0)

    def fill(
        self,
        chunks: SavedChunks,
        unit: int,
        lo: IntArray | None = None,
        hi: IntArray | None = None,
    ) -> None:
        """Add the cells of chunks to the tiles, which have none of them yet.

        Args:
            chunks: of each of the arrays.
            unit: units in one count.
            lo: the first cell that is wanted, shape (d,), x first; None: as far as there are any.
            hi: past the last one.

        Raises:
            ValueError: they are no counts.
        """
        tiles, d, side = self.tiles, self.tiles.ndim, self.tiles.side
        for cells, name in zip(chunks.cells, self.names, strict=True):
            check_counts(cells, unit, name)
            if lo is not None or hi is not None:
                clear_outside(chunks.first, cells, lo, hi)
        some = np.flatnonzero(np.any([used_blocks(c, side, d) for c in chunks.cells], axis=0))
        counts = [blocks_from_chunks(cells, side, d, some) for cells in chunks.cells]
        # Lengths are stored in place of passes.
        hits, passes = counts if len(counts) == 2 else (np.zeros_like(counts[0]), counts[0])
        append_counts(tiles, block_coords(chunks.first, side, some), hits, passes, unit)

    def create(self, folder: ShardFiles, form: Form) -> None:
        """Make the arrays."""
        for name, text in self.texts.items():
            about = {"description": text, "weight_unit": form.unit / ONE}
            folder.create(name, form.dtype, 0, about)

    def shards(self, form: Form) -> Iterator[StoredShard]:
        """The shards with a tile, to be written one by one."""
        tiles, d = self.tiles, self.tiles.ndim
        # Only a caller's own tiles reach over a chunk.
        fitting = tiles if CHUNK[d] % tiles.side == 0 else retiled(tiles, TILE_SIDE[d])
        for blocks in blocks_by_shard(fitting.coords, fitting.side):
            yield StoredShard(self._replace(tiles=fitting), blocks, form)


class StoredShard(NamedTuple):
    """The tiles of one shard."""

    of: StoredTiles
    blocks: ShardBlocks
    form: Form

    def arrays(self) -> Iterator[tuple[str, npt.NDArray[Any]]]:
        """Counts in the chunks that hold a tile, array by array, shape (k, cells of a chunk)."""
        tiles = self.of.tiles
        for name, channel in zip(self.of.names, self.of.channels, strict=True):
            counts = counts_of(tiles, self.blocks.blocks, channel, *self.form)
            yield name, self.blocks.to_chunks(counts, tiles.side)

    def write(self, folder: ShardFiles, first_place: IntArray) -> None:
        """Write them; threads may write several.

        Args:
            folder: the new map's.
            first_place: the first shard of its arrays, counted from cell 0, shape (d,), x first.
        """
        place = tuple((self.blocks.place - first_place)[::-1].tolist())
        for name, chunks in self.arrays():
            folder.write(name, place, self.blocks.numbers, chunks)


def stored_tiles(evidence: Evidence) -> list[StoredTiles]:
    """All tiles of a map: votes, and lengths where it keeps them."""
    stored = [StoredTiles(evidence.tiles, (HITS, PASSES), VOTES)]
    if evidence.lengths is not None:
        stored.append(StoredTiles(evidence.lengths, (PASSES,), LENGTHS))
    return stored


def reached_shards(evidence: Evidence) -> IntArray:
    """The shards that evidence lies in, counted from cell 0, shape (n, d), x first."""
    return np.unique(
        np.concatenate([stored.reached() for stored in stored_tiles(evidence)]), axis=0
    )


def unit_of(attributes: Mapping[str, Any], name: str) -> int:
    """Units in one count of an array.

    Raises:
        ValueError: it says none that there is.
    """
    unit = attributes["weight_unit"]
    if isinstance(unit, bool) or unit not in (1.0, 1 / ONE):
        raise ValueError(f"{name} has weight_unit {unit!r:.40}, which is 1.0 or 1/{ONE}")
    return round(float(unit) * ONE)


def check_counts(cells: npt.NDArray[Any], unit: int, name: str) -> None:
    """Refuse weights that no cell can have.

    Raises:
        ValueError: there are some.
    """
    most = HEAVIEST // unit
    if np.iinfo(cells.dtype).max > most and cells.max(initial=0) > most:
        raise ValueError(f"{name} holds weights that are not counts of 0 to 2^46 votes")
