# SPDX-License-Identifier: Apache-2.0
"""Blocks in chunks and shards, against every cell put in its place on its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.map_files.chunk_blocks import (
    block_coords,
    blocks_by_shard,
    blocks_from_chunks,
    clear_outside,
    used_blocks,
)
from oddsmap.map_files.zarr_folder import CHUNK, SHARD

Index = tuple[int, ...]


def cells_of(
    coords: npt.NDArray[np.int64], cells: npt.NDArray[Any], side: int
) -> dict[Index, float]:
    """Cells of blocks by their index, x first."""
    d = coords.shape[1]
    found = {}
    for at, values in zip(coords, cells, strict=True):
        for place, value in np.ndenumerate(values.reshape((side,) * d)):
            index = tuple(int(i) for i in at * side + place[::-1])
            assert index not in found
            found[index] = value
    return found


@settings(max_examples=25)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([(2, 4), (2, 32), (3, 2), (3, 8)]),
    st.sampled_from(["u1", "u2", "f4", "u8"]),
    st.sampled_from([0, 3]),
)
def test_every_cell_is_in_its_chunk(
    seed: int, sizes: tuple[int, int], dtype: str, fill: int
) -> None:
    (d, side), rng = sizes, np.random.default_rng(seed)
    reach = 2 * SHARD[d] // side
    coords = rng.permuted(np.unique(rng.integers(-reach, reach, (30, d)), axis=0), axis=0)[:8]
    coords = np.unique(coords, axis=0)
    # Some of them neighbours.
    coords = np.unique(np.concatenate([coords, coords[:3] + 1]), axis=0)
    cells = rng.integers(0, 200, (len(coords), side**d)).astype(dtype)
    wanted, known = cells_of(coords, cells, side), {tuple(at) for at in coords.tolist()}
    grid, seen = SHARD[d] // CHUNK[d], []
    for shard in blocks_by_shard(coords, side):
        seen += shard.blocks.tolist()
        assert (np.diff(shard.numbers) > 0).all()
        chunks = shard.to_chunks(cells[shard.blocks], side, fill)
        assert (chunks.dtype, chunks.shape) == (cells.dtype, (len(shard.numbers), CHUNK[d] ** d))
        assert set(shard.chunk.tolist()) == set(range(len(shard.numbers)))
        at = np.stack(np.unravel_index(shard.numbers, (grid,) * d)[::-1], axis=1)
        first = shard.place * SHARD[d] + at * CHUNK[d]
        every = np.arange(len(chunks) * (CHUNK[d] // side) ** d)
        again = blocks_from_chunks(chunks, side, d, every)
        # Cell by cell where anything is or should be; the blocks left out hold `fill` alone.
        places = block_coords(first, side, every)
        full = (again != fill).any(axis=1) | [tuple(at) in known for at in places.tolist()]
        found = cells_of(places[full], again[full], side)
        own = {index: wanted.pop(index) for index in found if index in wanted}
        assert len(own) == len(shard.blocks) * side**d
        assert all(found[index] == value for index, value in own.items())
        assert all(value == fill for index, value in found.items() if index not in own)
        used = used_blocks(chunks != fill, side, d)
        assert used.tolist() == (again != fill).any(axis=1).tolist()
        some = rng.permutation(np.flatnonzero(used))
        np.testing.assert_array_equal(blocks_from_chunks(chunks, side, d, some), again[some])
    assert sorted(seen) == list(range(len(coords)))
    assert wanted == {}


@pytest.mark.parametrize("d", [2, 3])
def test_shards_come_in_order(d: int) -> None:
    coords = np.stack(np.meshgrid(*[[-900, 0, 900]] * d), axis=-1).reshape(-1, d)
    places = [tuple(shard.place[::-1]) for shard in blocks_by_shard(coords, CHUNK[d])]
    assert places == sorted(places)
    assert len(places) == 3**d


def test_no_blocks_are_in_no_shard() -> None:
    assert list(blocks_by_shard(np.empty((0, 3), np.int64), 8)) == []


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.sampled_from(["u1", "u4", "u8"]))
def test_used_blocks(seed: int, d: int, dtype: str) -> None:
    rng = np.random.default_rng(seed)
    chunks = np.zeros((3, CHUNK[d] ** d), dtype)
    places = rng.integers(0, chunks.size, 20)
    chunks.ravel()[places] = 1
    chunks <<= chunks.dtype.type(rng.integers(8 * chunks.itemsize))
    for side in (1, 8, 32):
        every = np.arange(len(chunks) * (CHUNK[d] // side) ** d)
        cells = blocks_from_chunks(chunks, side, d, every)
        assert used_blocks(chunks, side, d).tolist() == cells.any(axis=1).tolist()


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]))
def test_cells_outside_a_box_are_cleared(seed: int, d: int) -> None:
    rng = np.random.default_rng(seed)
    first = rng.integers(-3, 3, (2, d)) * CHUNK[d]
    lo, hi = rng.integers(-100, 100, (2, d))
    before = rng.integers(1, 9, (2, CHUNK[d] ** d)).astype("u2")
    grid = np.indices((CHUNK[d],) * d).reshape(d, -1)[::-1].T
    index = first[:, None] + grid
    for low, high in ((lo, hi), (lo, None), (None, hi), (None, None)):
        chunks = before.copy()
        clear_outside(first, chunks, low, high)
        inside = np.ones(before.shape, np.bool_)
        if low is not None:
            inside &= (index >= low).all(axis=2)
        if high is not None:
            inside &= (index < high).all(axis=2)
        np.testing.assert_array_equal(chunks, before * inside)


@pytest.mark.parametrize("d", [2, 3])
def test_no_chunks_hold_no_blocks(d: int) -> None:
    chunks, none = np.empty((0, CHUNK[d] ** d), np.uint8), np.empty(0, np.int64)
    assert used_blocks(chunks, 8, d).shape == (0,)
    assert blocks_from_chunks(chunks, 8, d, none).shape == (0, 8**d)
    assert block_coords(np.empty((0, d), np.int64), 8, none).shape == (0, d)
