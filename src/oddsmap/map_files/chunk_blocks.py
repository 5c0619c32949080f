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

__all__ = [
    "ShardBlocks",
    "block_coords",
    "blocks_by_shard",
    "blocks_from_chunks",
    "clear_outside",
    "used_blocks",
]


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


def used_blocks(chunks: npt.NDArray[Any], side: int, d: int) -> npt.NDArray[np.bool_]:
    """Find the blocks that hold anything but zeros.

    Args:
        chunks: whole numbers or truth values, shape (n, chunk^d), x fastest.
        side: cells along a block's side, which divides a chunk's.
        d: 2 or 3.

    Returns:
        Shape (n * (chunk / side)^d,): chunk by chunk, x fastest.
    """
    n, across = len(chunks), CHUNK[d] // side
    # Eight bytes at a time, the slowest axis first: it leaves a part of them for the others.
    joint = words = chunks.view(np.uint64 if side * chunks.itemsize % 8 == 0 else np.uint8)
    row = words.shape[1] // CHUNK[d] ** (d - 1)
    for axis in range(1, d):
        of_one_place = row * CHUNK[d] ** (d - 1 - axis)
        joint = np.bitwise_or.reduce(joint.reshape(n * across**axis, side, of_one_place), axis=1)
    used: npt.NDArray[np.bool_]
    used = np.logical_or.reduce(joint.reshape(n * across**d, row // across), axis=1)
    return used


def blocks_from_chunks(
    chunks: npt.NDArray[Any], side: int, d: int, chosen: IntArray
) -> npt.NDArray[Any]:
    """Cut blocks out of chunks.

    Args:
        chunks: shape (n, chunk^d), x fastest.
        side: cells along a block's side, which divides a chunk's.
        d: 2 or 3.
        chosen: which blocks, counted as in `used_blocks`, shape (m,).

    Returns:
        Their cells, shape (m, side^d), x fastest.
    """
    across = CHUNK[d] // side
    chunk, within = _places(chosen, across, d)
    where = [part for at in within[:0:-1] for part in (at, slice(None))]
    rows = _rows(chunks, side).reshape(len(chunks), *(across, side) * (d - 1), across)
    copied: npt.NDArray[Any] = rows[(chunk, *where, within[0])]
    return copied.view(chunks.dtype).reshape(len(chosen), side**d)


def block_coords(first: IntArray, side: int, chosen: IntArray) -> IntArray:
    """Coordinates of blocks in chunks.

    Args:
        first: the first cell of each chunk, shape (n, d), x first.
        side: cells along a block's side.
        chosen: which blocks, counted as in `used_blocks`, shape (m,).

    Returns:
        In blocks from cell 0, shape (m, d), x first.
    """
    d = first.shape[1]
    chunk, within = _places(chosen, CHUNK[d] // side, d)
    return first[chunk] // side + np.stack(within, axis=1)


def clear_outside(
    first: IntArray, chunks: npt.NDArray[Any], lo: IntArray | None, hi: IntArray | None
) -> None:
    """Set cells outside a box to zero.

    Args:
        first: the first cell of each chunk, shape (n, d), x first.
        chunks: shape (n, chunk^d), x fastest.
        lo: the first cell of the box, shape (d,), x first; None: as far as there are any.
        hi: past its last cell.
    """
    d = first.shape[1]
    along = first[:, :, None] + np.arange(CHUNK[d])
    outside = np.zeros(along.shape, np.bool_)
    if lo is not None:
        outside |= along < lo[:, None]
    if hi is not None:
        outside |= along >= hi[:, None]
    for row in np.flatnonzero(outside.any(axis=(1, 2))):
        box = chunks[row].reshape((CHUNK[d],) * d)
        for axis in range(d):
            np.moveaxis(box, d - 1 - axis, 0)[outside[row, axis]] = 0


def _places(chosen: IntArray, across: int, d: int) -> tuple[IntArray, list[IntArray]]:
    """In which chunk blocks are, and where in it, in blocks, x first."""
    chunk, within = np.divmod(chosen, across**d)
    return chunk, [within // across**axis % across for axis in range(d)]


def _rows(cells: npt.NDArray[Any], side: int) -> npt.NDArray[np.void]:
    # A row of a block as one thing to copy: four times as fast as cell by cell.
    return cells.view(np.dtype((np.void, side * cells.itemsize)))
