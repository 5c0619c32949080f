# SPDX-License-Identifier: Apache-2.0
"""The census of tiles and their cells in order, against a sort of all cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import MAX_UNITS, ONE

IntArray = npt.NDArray[np.int64]
coordinate = st.one_of(st.integers(-3, 3), st.sampled_from([-(1 << 30), 1 << 32, (1 << 40) - 1]))
weight = st.sampled_from([0, 0, 0, 1, ONE - 1, ONE, 200 * ONE, 300 * ONE, 1 << 40])


def by_sorting(store: TileStore) -> tuple[IntArray, IntArray, IntArray]:
    """The slow way: every cell of every tile, those without a weight left out, sorted."""
    found: dict[tuple[int, ...], tuple[int, int]] = {}
    for coords, units in store.chunks():
        for at, (hits, passes) in zip(coords.tolist(), units.tolist(), strict=True):
            for number, (h, p) in enumerate(zip(hits, passes, strict=True)):
                rest, cell = number, []
                for axis in range(store.ndim):
                    cell.append(at[axis] * store.side + rest % store.side)
                    rest //= store.side
                if h or p:
                    found[tuple(cell)] = (h, p)
    order = sorted(found, key=lambda cell: cell[::-1])
    index = np.array(order, np.int64).reshape(-1, store.ndim)
    weights = np.array([found[cell] for cell in order], np.int64).reshape(-1, 2)
    return index, weights[:, 0], weights[:, 1]


@settings(max_examples=80)
@given(st.data(), st.sampled_from([2, 3]), st.sampled_from([1, 2, 3, 8]))
def test_against_a_sort(data: st.DataObject, d: int, side: int) -> None:
    store = TileStore(d, side)
    for _ in range(data.draw(st.integers(0, 3))):
        places = data.draw(st.lists(st.tuples(*[coordinate] * d), max_size=6, unique=True))
        rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
        kinds = np.array(data.draw(st.lists(weight, min_size=1, max_size=5)), np.int64)
        units = rng.choice(kinds, (len(places), 2, side**d))
        store.add(np.array(places, np.int64).reshape(-1, d), units)
    index, hits, passes = by_sorting(store)
    for mine, slow in zip(store.cells(), (index, hits, passes), strict=True):
        assert mine.tolist() == slow.tolist()
    census = store.census()
    assert (census.cells, census.hits, census.passes) == (
        len(index), sum(hits.tolist()), sum(passes.tolist())
    )  # fmt: skip
    assert census.largest == max([0, *hits.tolist(), *passes.tolist()])
    assert census.whole_votes == (not ((hits | passes) % ONE).any())
    if len(index) == 0:
        assert census.bounds is None
    else:
        assert census.bounds is not None
        assert census.bounds[0].tolist() == index.min(axis=0).tolist()
        assert census.bounds[1].tolist() == (index.max(axis=0) + 1).tolist()


@pytest.mark.parametrize("d", [2, 3])
def test_sums_beyond_64_bits(d: int) -> None:
    store = TileStore(d, 8)
    units = np.full((1, 2, 8**d), MAX_UNITS - 256 * ONE, np.int64)
    store.add(np.zeros((1, d), np.int64), units)
    assert store.census().hits == 8**d * (MAX_UNITS - 256 * ONE) > 2**63
