# SPDX-License-Identifier: Apache-2.0
"""The tile store: hash, growth and the two levels, against a dictionary."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.errors import ConfigError, MapTooLargeError
from oddsmap.evidence import tiles
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import HITS, MAX_UNITS, ONE, PASSES
from oddsmap.kernels.vote.tiles import ANY_FULL, NARROW_MAX, WIDE_COUNT, find, has_room
from oddsmap.limits import memory_limit

IntArray = npt.NDArray[np.int64]
Sums = dict[tuple[int, ...], IntArray]

# Neighbours, negative ones, and ones that no 32-bit hash would tell apart.
coordinate = st.one_of(st.integers(-4, 4), st.sampled_from([-(1 << 40), 1 << 32, (1 << 44) - 1]))
# Whole votes, fractions, and steps that fill a byte in one go or in two.
weight = st.sampled_from([0, 1, ONE - 1, ONE, 2 * ONE, 128 * ONE, 255 * ONE, 256 * ONE, 1 << 40])


def contents(store: TileStore) -> Sums:
    return {
        tuple(map(int, at)): units.copy()
        for coords, part in store.chunks()
        for at, units in zip(coords, part, strict=True)
    }


def as_lists(sums: Sums) -> dict[tuple[int, ...], list[list[int]]]:
    return {at: units.tolist() for at, units in sums.items() if units.any()}


@given(st.data(), st.sampled_from([2, 3]), st.sampled_from([1, 2, 3]))
@settings(max_examples=60)
def test_adding_is_a_sum(data: st.DataObject, d: int, side: int) -> None:
    store = TileStore(d, side)
    want: Sums = {}
    for _ in range(data.draw(st.integers(1, 12))):
        places = data.draw(st.lists(st.tuples(*[coordinate] * d), max_size=6, unique=True))
        units = np.array(
            [
                data.draw(st.lists(weight, min_size=2 * side**d, max_size=2 * side**d))
                for _ in places
            ],
            np.int64,
        ).reshape(-1, 2, side**d)
        store.add(np.array(places, np.int64).reshape(-1, d), units)
        for place, part in zip(places, units, strict=True):
            want[place] = want[place] + part if place in want else part
        assert as_lists(contents(store)) == as_lists(want)
    for slot, at in enumerate(store.coords):
        assert find(store.arrays, at) == slot
    assert find(store.arrays, np.full(d, 99, np.int64)) == -1
    assert store.count == len(want)


def test_many_tiles_survive_growth() -> None:
    store = TileStore(2, 1)
    for k in range(2000):
        store.add(np.array([[k % 50 - 25, k // 50]]), np.full((1, 2, 1), (k + 1) * ONE))
    held = contents(store)
    assert store.count == len(held) == 2000
    for k in range(2000):
        assert held[k % 50 - 25, k // 50].tolist() == [[(k + 1) * ONE]] * 2


@pytest.mark.parametrize("channel", [HITS, PASSES])
@pytest.mark.parametrize("times", [254, 255, 256, 510, 511, 700])
def test_flushing_loses_no_vote(channel: int, times: int) -> None:
    store = TileStore(2, 2)
    units = np.zeros((1, 2, 4), np.int64)
    units[0, channel, 3] = ONE
    other = np.zeros((1, 2, 4), np.int64)
    other[0, 1 - channel, 0] = ONE
    for k in range(times):
        store.add(np.array([[0, 0]]), units)
        if k % 3 == 0:
            store.add(np.array([[0, 0]]), other)
    held = contents(store)[0, 0]
    assert held[channel].tolist() == [0, 0, 0, times * ONE]
    assert held[1 - channel].tolist() == [-(-times // 3) * ONE, 0, 0, 0]


def test_whole_votes_need_no_wide_row() -> None:
    store = TileStore(3, 2)
    units = np.full((1, 2, 8), ONE)
    for _ in range(NARROW_MAX):
        store.add(np.array([[0, 0, 0]]), units)
    assert store.arrays.counts[WIDE_COUNT] == 0
    assert store.arrays.counts[ANY_FULL] == 1
    before = store.nbytes
    store.add(np.array([[0, 0, 0]]), units)
    assert store.arrays.counts[WIDE_COUNT] == 1
    assert store.nbytes == before + 8 * 2 * 8


def test_room_is_counted_for_full_tiles_and_fractions() -> None:
    store = TileStore(2, 2)
    store.reserve(3, 1)
    assert has_room(store.arrays, 3, False)
    assert not has_room(store.arrays, 4, False)
    assert has_room(store.arrays, 1, True)
    assert not has_room(store.arrays, 2, True)
    store.arrays.counts[ANY_FULL] = 1
    assert not has_room(store.arrays, 2, False)


@pytest.mark.parametrize("most", [MAX_UNITS, MAX_UNITS - 254 * ONE])
def test_too_much_for_a_cell_changes_nothing(most: int) -> None:
    store = TileStore(2, 1)
    store.add(np.array([[0, 0], [1, 0]]), np.array([[[5], [7]], [[ONE], [0]]]))
    before = as_lists(contents(store))
    with pytest.raises(MapTooLargeError, match=r"2\^46 votes"):
        store.add(np.array([[1, 0], [2, 0]]), np.array([[[most], [0]], [[1], [1]]]))
    assert as_lists(contents(store)) == before


def test_the_most_that_fits() -> None:
    store = TileStore(2, 1)
    start = MAX_UNITS - 256 * ONE
    store.add(np.array([[0, 0]]), np.array([[[start], [0]]]))
    for _ in range(256):  # 255 fill the narrow level, the last one goes to the wide one
        store.add(np.array([[0, 0]]), np.array([[[ONE], [0]]]))
    assert contents(store)[0, 0].tolist() == [[MAX_UNITS], [0]]
    with pytest.raises(MapTooLargeError):
        store.add(np.array([[0, 0]]), np.array([[[ONE], [0]]]))
    assert contents(store)[0, 0].tolist() == [[MAX_UNITS], [0]]


def test_memory_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    store = TileStore(2, 8)
    store.add(np.array([[0, 0]]), np.ones((1, 2, 64), np.int64))
    with pytest.raises(MapTooLargeError, match="no memory for"):
        store.reserve(1 << 50, 0)
    monkeypatch.setattr(tiles, "memory_limit", lambda: 100)
    with pytest.raises(MapTooLargeError, match="coarser resolution"):
        store.add(np.array([[1, 0]]), np.ones((1, 2, 64), np.int64))
    assert store.count == 1
    monkeypatch.undo()
    assert 1 << 28 < memory_limit() <= 1 << 62


@pytest.mark.parametrize(("d", "side"), [(1, 8), (4, 8), (2, 0), (2, -1), (2, 1025)])
def test_odd_shapes_are_refused(d: int, side: int) -> None:
    with pytest.raises(ConfigError, match="tiles need"):
        TileStore(d, side)
