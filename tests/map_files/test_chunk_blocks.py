# SPDX-License-Identifier: Apache-2.0
"""Blocks in chunks and shards, against every cell put in its place on its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.map_files.chunk_blocks import block_coords, blocks_by_shard, blocks_from_chunks
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
    wanted = cells_of(coords, cells, side)
    grid, seen = SHARD[d] // CHUNK[d], []
    for shard in blocks_by_shard(coords, side):
        seen += shard.blocks.tolist()
        assert (np.diff(shard.numbers) > 0).all()
        chunks = shard.to_chunks(cells[shard.blocks], side, fill)
        assert (chunks.dtype, chunks.shape) == (cells.dtype, (len(shard.numbers), CHUNK[d] ** d))
        assert set(shard.chunk.tolist()) == set(range(len(shard.numbers)))
        at = np.stack(np.unravel_index(shard.numbers, (grid,) * d)[::-1], axis=1)
        first = shard.place * SHARD[d] + at * CHUNK[d]
        again = blocks_from_chunks(chunks, side, d)
        found = cells_of(block_coords(first, side), again, side)
        own = {index: wanted.pop(index) for index in found if index in wanted}
        assert len(own) == len(shard.blocks) * side**d
        assert all(found[index] == value for index, value in own.items())
        assert all(value == fill for index, value in found.items() if index not in own)
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
