# SPDX-License-Identifier: Apache-2.0
"""Tiles to the counts that are stored, and back, against weights of single cells."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.evidence.tile_counts import append_counts, counts_of, retiled
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import HITS, MAX_UNITS, ONE, PASSES
from oddsmap.kernels.vote.tiles import ANY_FULL, WIDE_COUNT

KINDS = [(ONE, "u1", 255), (ONE, "u2", 60_000), (ONE, "u8", 1 << 45), (1, "u4", 1 << 31)]


def random_counts(seed: int, cells: int, dtype: str, most: int) -> npt.NDArray[Any]:
    """Tiles with few counts, some up to the most."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, min(most, 3) + 1, (20, 2, cells)).astype(dtype)
    counts[rng.random(counts.shape) < 0.99] = 0
    counts[:, rng.integers(2), rng.integers(cells)] |= 1
    if rng.random() < 0.7:
        counts[rng.integers(20), 0, rng.integers(cells)] = most
    return counts


@settings(max_examples=40)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([(2, 4), (2, 8), (3, 4), (3, 8)]),
    st.sampled_from(KINDS),
)
def test_there_and_back(seed: int, sizes: tuple[int, int], kind: tuple[int, str, int]) -> None:
    (d, side), (unit, dtype, most) = sizes, kind
    counts = random_counts(seed, side**d, dtype, most)
    rng = np.random.default_rng(seed)
    coords = np.unique(rng.integers(-50, 50, (60, d)), axis=0)[:20]
    tiles = TileStore(d, side)
    # In two parts, as shards come.
    for part in (slice(0, 13), slice(13, 20)):
        append_counts(tiles, coords[part], counts[part, 0], counts[part, 1], unit)
    assert tiles.coords.tolist() == coords.tolist()
    for channel in (HITS, PASSES):
        found = counts_of(tiles, np.arange(tiles.count), channel, unit, dtype)
        assert found.dtype == dtype
        np.testing.assert_array_equal(found, counts[:, channel])
    for at, count in zip(coords, counts, strict=True):
        box = tiles.region(at * side, (at + 1) * side)
        assert box.reshape(2, -1).tolist() == (count.astype(np.int64) * unit).tolist()
    # Whole votes of a byte need no wide rows, and room for one more is known to be left or not.
    in_bytes = unit == ONE and int(counts.max()) <= 255
    assert (int(tiles.arrays.counts[WIDE_COUNT]) == 0) == in_bytes
    narrow = tiles.arrays.narrow[: tiles.count]
    assert bool(tiles.arrays.counts[ANY_FULL]) == bool((narrow == 255).any())
    assert (tiles.arrays.load[: tiles.count] >= narrow.max(axis=(1, 2), initial=0)).all()
    # They take more like any other tiles.
    tiles.add_cells(coords[:1] * side, np.full((1, 2), 300 * ONE))
    added = tiles.region(coords[0] * side, coords[0] * side + 1).ravel()
    assert added.tolist() == (counts[0, :, 0].astype(np.int64) * unit + 300 * ONE).tolist()


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(("side", "other"), [(1, 8), (3, 8), (7, 4), (16, 5), (40, 8)])
def test_tiles_of_another_side(d: int, side: int, other: int) -> None:
    rng = np.random.default_rng(side)
    tiles = TileStore(d, side)
    index = np.unique(rng.integers(-50, 50, (300, d)), axis=0)
    tiles.add_cells(index, rng.integers(0, 1 << 30, (len(index), 2)))
    tiles.add_cells(index[:100], rng.integers(0, 256, (100, 2)) * ONE)
    again = retiled(tiles, other)
    assert again.side == other
    for one, two in zip(tiles.cells(), again.cells(), strict=True):
        np.testing.assert_array_equal(one, two)


def test_the_heaviest_cell_in_tiles_of_another_side() -> None:
    tiles = TileStore(2, 3)
    tiles.add_cells(np.array([[4, 4]]), np.array([[200 * ONE, 0]]))
    tiles.add_cells(np.array([[4, 4]]), np.array([[MAX_UNITS - 255 * ONE, 1]]))
    assert retiled(tiles, 32).at(np.array([[4, 4]]))[0].tolist() == [MAX_UNITS - 55 * ONE]
