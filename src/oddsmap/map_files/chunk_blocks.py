# SPDX-License-Identifier: Apache-2.0
"""Blocks of cells, as maps hold them in memory, in the chunks and shards of a saved map, and back.

Rows of cells are copied whole, whatever a cell is: no cell is looked at, and no block is sorted
into its place more than once.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.map_files.zarr_folder import CHUNK, SHARD

__all__ = ["ShardBlocks", "block_coords", "blocks_by_shard", "blocks_from_chunks"]


class ShardBlocks(NamedTuple):
    """The blocks that lie in one shard, chunk by chunk."""

    place: IntArray
    """Of the shard, in shards from cell 0, shape (d,), x first."""
    numbers: IntArray
    """Of its chunks that hold a block, in ascending order, x fastest, shape (k,)."""
    blocks: IntArray
    """Which blocks, shape (m,)."""
    chunk: IntArray
    """In which of those chunks each lies, 0 to k - 1, shape (m,)."""
    within: IntArray
    """Where in its chunk, in blocks, shape (m, d), x first."""

    def to_chunks(
        self, cells: npt.NDArray[Any], side: int, fill_value: float = 0
    ) -> npt.NDArray[Any]:
        """Put blocks together.

        Args:
            cells: of each block of the shard, shape (m, side^d), x fastest.
            side: cells along a block's side.
            fill_value: of cells in no block.

        Returns:
            Cells of each chunk, of the same type, shape (k, chunk^d), x fastest.
        """
        d = self.within.shape[1]
        across = CHUNK[d] // side
        shape = len(self.numbers), CHUNK[d] ** d
        # Zeros are given by the system, and written by nobody.
        chunks = np.zeros(shape, cells.dtype)
        if fill_value != 0:
            chunks[:] = fill_value
        where = [part for at in self.within.T[:0:-1] for part in (at, slice(None))]
        rows = _rows(chunks, side).reshape(-1, *(across, side) * (d - 1), across)
        rows[(self.chunk, *where, self.within[:, 0])] = _rows(cells, side).reshape(
            -1, *(side,) * (d - 1)
        )
        return chunks


def blocks_by_shard(coords: IntArray, side: int) -> Iterator[ShardBlocks]:
    """Sort blocks into shards.

    Args:
        coords: of the blocks, in blocks from cell 0, shape (n, d), x first, each at most once.
        side: cells along a block's side, which divides a chunk's.

    Yields:
        Shards with a block, z before y before x.
    """
    d = coords.shape[1]
    across, grid = CHUNK[d] // side, SHARD[d] // CHUNK[d]
    chunks = coords // across
    within = coords - chunks * across
    places = chunks // grid
    numbers = ((chunks - places * grid) * grid ** np.arange(d)).sum(axis=1)
    order = np.lexsort((numbers, *places.T))
    another = (np.diff(places[order], axis=0) != 0).any(axis=1)
    for blocks in np.split(order, np.flatnonzero(another) + 1):
        if len(blocks):
            own, chunk = np.unique(numbers[blocks], return_inverse=True)
            yield ShardBlocks(places[blocks[0]], own, blocks, chunk, within[blocks])


def blocks_from_chunks(chunks: npt.NDArray[Any], side: int, d: int) -> npt.NDArray[Any]:
    """Cut chunks into blocks.

    Args:
        chunks: shape (n, chunk^d), x fastest.
        side: cells along a block's side, which divides a chunk's.
        d: 2 or 3.

    Returns:
        Cells of each block, shape (n * (chunk / side)^d, side^d): chunk by chunk, x fastest.
    """
    across = CHUNK[d] // side
    rows = _rows(chunks, side).reshape(-1, *(across, side) * (d - 1), across)
    # (chunk, tz, z, ty, y, tx) becomes (chunk, tz, ty, tx, z, y).
    order = (0, *range(1, 2 * d, 2), *range(2, 2 * d, 2))
    copied = np.ascontiguousarray(rows.transpose(order))
    return copied.view(chunks.dtype).reshape(-1, side**d)


def block_coords(first: IntArray, side: int) -> IntArray:
    """Coordinates of the blocks that `blocks_from_chunks` gives.

    Args:
        first: the first cell of each chunk, shape (n, d), x first.
        side: cells along a block's side.

    Returns:
        In blocks from cell 0, shape (n * (chunk / side)^d, d), x first.
    """
    d = first.shape[1]
    across = CHUNK[d] // side
    within = np.stack(np.unravel_index(np.arange(across**d), (across,) * d)[::-1], axis=1)
    return (first[:, None] // side + within).reshape(-1, d)


def _rows(cells: npt.NDArray[Any], side: int) -> npt.NDArray[np.void]:
    # A row of a block as one thing to copy: four times as fast as cell by cell.
    return cells.view(np.dtype((np.void, side * cells.itemsize)))
