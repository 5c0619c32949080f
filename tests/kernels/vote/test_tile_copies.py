# SPDX-License-Identifier: Apache-2.0
"""Tiles to the arrays that are stored, and back, against the region of a map."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import ONE
from oddsmap.kernels.vote.tiles import ANY_FULL, WIDE_COUNT

KINDS = [(ONE, "u1", 255), (ONE, "u2", 60_000), (ONE, "u8", 1 << 45), (1, "u4", 1 << 31)]


def random_counts(seed: int, d: int, width: int, dtype: str, most: int) -> npt.NDArray[Any]:
    """A box of mostly empty tiles, some with counts up to the most."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, min(most, 3) + 1, (2, *(width,) * d)).astype(dtype)
    counts[rng.random(counts.shape) < 0.99] = 0
    if rng.random() < 0.7:
        counts[(0, *rng.integers(0, width, d))] = most
    return counts


@settings(max_examples=40)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([(2, 4, 32), (2, 8, 16), (3, 4, 16), (3, 8, 16)]),
    st.sampled_from(KINDS),
)
def test_there_and_back(seed: int, sizes: tuple[int, int, int], kind: tuple[int, str, int]) -> None:
    (d, side, width), (unit, dtype, most) = sizes, kind
    counts = random_counts(seed, d, width, dtype, most)
    begin = np.random.default_rng(seed).integers(-3, 3, d) * width
    tiles = TileStore(d, side)
    tiles.fill_counts(begin, unit, counts)
    np.testing.assert_array_equal(
        tiles.region(begin, begin + width), counts.astype(np.int64) * unit
    )
    np.testing.assert_array_equal(tiles.counts_in(begin, width, unit, dtype), counts)
    # Whole votes of a byte need no wide rows, and room for one more is known to be left or not.
    small = unit == ONE and int(counts.max()) <= 255
    assert (int(tiles.arrays.counts[WIDE_COUNT]) == 0) == (small or not counts.any())
    assert bool(tiles.arrays.counts[ANY_FULL]) == (unit == ONE and _any_tile_of_255(tiles))
    # They take more like any other tiles.
    tiles.add_cells(begin[None], np.full((1, 2), 300 * ONE))
    added = tiles.region(begin, begin + 1).ravel()
    corner = counts.reshape(2, -1)[:, 0].astype(np.int64) * unit
    assert added.tolist() == (corner + 300 * ONE).tolist()


def _any_tile_of_255(tiles: TileStore) -> bool:
    narrow = tiles.arrays.narrow[: tiles.count]
    return bool(narrow.size) and int(narrow.max()) == 255


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("side", [1, 3, 5, 7])
def test_tiles_that_do_not_divide_the_box(d: int, side: int) -> None:
    rng = np.random.default_rng(side)
    tiles = TileStore(d, side)
    index = np.unique(rng.integers(-20, 20, (300, d)), axis=0)
    tiles.add_cells(index, rng.integers(0, 5, (len(index), 2)) * ONE)
    for begin in ([-16] * d, [0] * d, [-3] * d):
        first = np.array(begin)
        counts = tiles.counts_in(first, 16, ONE, "u1")
        np.testing.assert_array_equal(
            counts.astype(np.int64) * ONE, tiles.region(first, first + 16)
        )
