# SPDX-License-Identifier: Apache-2.0
"""Sums, differences and coarser cells of maps: against dictionaries, and among each other."""

from __future__ import annotations

import math
from functools import reduce
from itertools import permutations, product
from operator import add

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import BeamSensor, ConeSensor, EvidenceMap
from oddsmap.config.config import PosteriorConfig
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.kernels.units import MAX_UNITS
from tests.kit import ONE, Votes, add_votes, votes_of

near, far = st.integers(-20, 20), st.integers(-1100, 1100)
weight = st.one_of(st.sampled_from([0, ONE, 255 * ONE, 256 * ONE]), st.integers(0, 3 * ONE))
weights = st.tuples(weight, weight)
plane = st.dictionaries(st.tuples(st.one_of(near, far), near), weights, max_size=8)
space = st.dictionaries(st.tuples(near, near, near), weights, max_size=8)
either = st.one_of(st.tuples(*3 * [plane]), st.tuples(*3 * [space]))
side = st.sampled_from([1, 5, 8, 32])
few = settings(max_examples=40)


def map_of(votes: Votes, *, tile_side: int | None = None, resolution: float = 0.25) -> EvidenceMap:
    """A map of d dimensions; of two where nothing says it."""
    ndim = len(next(iter(votes), (0, 0)))
    grid = EvidenceMap(resolution, ndim=ndim, tile_side=tile_side)
    add_votes(grid, votes)
    return grid


def of_one_dimension(every: tuple[Votes, ...]) -> list[Votes]:
    """Without maps that are empty and so say no dimension."""
    return [votes for votes in every if votes]


def coarse_votes(votes: Votes, factor: int) -> Votes:
    found: Votes = {}
    for at, (hits, passes) in votes.items():
        cell = tuple(math.floor(i / factor) for i in at)
        before = found.get(cell, (0, 0))
        found[cell] = (before[0] + hits, before[1] + passes)
    return {at: vote for at, vote in found.items() if vote != (0, 0)}


@few
@given(either)
def test_the_order_of_a_sum_changes_nothing(every: tuple[Votes, ...]) -> None:
    maps = [map_of(votes) for votes in of_one_dimension(every)]
    sums = [votes_of(reduce(add, order)) for order in permutations(maps) if order]
    assert all(each == sums[0] for each in sums)


def test_sum_of_maps() -> None:
    maps = [map_of({(i, 0): (ONE, 0)}) for i in range(3)]
    total = sum(maps)
    assert isinstance(total, EvidenceMap)
    assert votes_of(total) == {(i, 0): (ONE, 0) for i in range(3)}
    assert votes_of(maps[0]) == {(0, 0): (ONE, 0)}


@few
@given(either, side, side)
def test_what_was_added_is_taken_out_again(every: tuple[Votes, ...], one: int, other: int) -> None:
    first, *others = of_one_dimension(every) or [{}]
    for votes in others:
        grid, more = map_of(first, tile_side=one), map_of(votes, tile_side=other)
        grid.record("first.log")
        more.record("more.log", scans=3)
        total = grid + more
        rest = total - more
        assert votes_of(rest) == votes_of(grid)
        assert rest.provenance == grid.provenance
        assert rest.config == grid.config
        assert (votes_of(grid), votes_of(more)) == (
            votes_of(map_of(first)), votes_of(map_of(votes))
        )  # fmt: skip
    nothing = map_of(first) - map_of(first)
    assert nothing.tiles.count == 0


@few
@given(either, side, side)
def test_no_more_is_taken_out_than_there_is(every: tuple[Votes, ...], one: int, other: int) -> None:
    first, *others = of_one_dimension(every) or [{}]
    for less in others:
        grid = map_of(first, tile_side=one)
        enough = all(
            kind <= has
            for at, vote in less.items()
            for kind, has in zip(vote, first.get(at, (0, 0)), strict=True)
        )
        if enough:
            grid.subtract(map_of(less, tile_side=other))
        else:
            with pytest.raises(InputError, match="does not hold the evidence"):
                grid.subtract(map_of(less, tile_side=other))
            assert votes_of(grid) == votes_of(map_of(first))


@few
@given(either, side, st.sampled_from([1, 2, 3, 7, 40]))
def test_coarser_cells_hold_the_sums(every: tuple[Votes, ...], tiles: int, factor: int) -> None:
    for votes in of_one_dimension(every):
        grid = map_of(votes, tile_side=tiles)
        coarse = grid.resample(0.25 * factor)
        assert votes_of(coarse) == coarse_votes(votes, factor)
        assert coarse.resolution == 0.25 * factor
        assert votes_of(grid) == votes_of(map_of(votes))
        if factor in (2, 3):
            again = coarse.resample(0.25 * factor * 2)
            assert votes_of(again) == votes_of(grid.resample(0.5 * factor))


@few
@given(either, st.sampled_from([2, 3]))
def test_sums_of_coarse_maps_are_coarse_sums(every: tuple[Votes, ...], factor: int) -> None:
    maps = [map_of(votes) for votes in of_one_dimension(every)]
    for one, other in product(maps, maps):
        sum_first = (one + other).resample(0.25 * factor)
        sum_last = one.resample(0.25 * factor) + other.resample(0.25 * factor)
        assert votes_of(sum_first) == votes_of(sum_last)


@few
@given(either, st.tuples(near, near, near), st.tuples(*3 * [st.integers(1, 60)]))
def test_crops_of_sums_are_sums_of_crops(
    every: tuple[Votes, ...], lo: tuple[int, ...], size: tuple[int, ...]
) -> None:
    maps = [map_of(votes) for votes in of_one_dimension(every)]
    for one, other in product(maps, maps):
        d = one.ndim
        first = np.array(lo[:d])
        box = first, first + size[:d]
        assert votes_of((one + other).crop(*box)) == votes_of(one.crop(*box) + other.crop(*box))


@few
@given(plane, st.tuples(near, near), st.tuples(*2 * [st.integers(1, 60)]),
       st.sampled_from([0.05, 0.1, 0.3, 1 / 3]))  # fmt: skip
def test_a_box_along_cells_is_met_exactly(
    votes: Votes, lo: tuple[int, int], size: tuple[int, int], resolution: float
) -> None:
    """In metres with few digits, as people write them; and boxes side by side share no cell."""
    grid = map_of(votes, resolution=resolution)
    hi = (lo[0] + size[0], lo[1] + size[1])
    corners = [[float(f"{i * resolution:.9g}") for i in corner] for corner in (lo, hi)]
    assert votes_of(grid.crop_box(*corners)) == votes_of(grid.crop(lo, hi))
    half = (lo[0] + 0.37 * size[0]) * resolution
    left = grid.crop_box(corners[0], (half, corners[1][1]))
    right = grid.crop_box((half, corners[0][1]), corners[1])
    assert votes_of(left + right) == votes_of(grid.crop(lo, hi))
    assert not votes_of(left).keys() & votes_of(right).keys()


def test_a_cell_is_in_a_box_if_its_centre_is() -> None:
    grid = map_of({(i, 0): (ONE, 0) for i in range(5)}, resolution=1.0)
    for lo, hi, want in (
        ((0.5, 0.0), (2.5, 1.0), {0, 1}),
        ((0.6, 0.4), (2.6, 0.6), {1, 2}),
        ((0.6, 0.0), (1.4, 1.0), set()),
        ((-9, -9), (9, 9), set(range(5))),
    ):
        assert {x for x, _ in votes_of(grid.crop_box(lo, hi))} == want


@pytest.mark.parametrize(
    ("lo", "hi", "said"),
    [((0, 0, 0), (1, 1, 1), "2 numbers"), ((0, 0), (1, math.nan), "2 numbers"),
     ((1, 0), (0, 1), "before its highest"), ((0, 0), (1, 0), "before its highest"),
     (("a", "b"), (1, 1), "2 numbers"), ((0, 0), (1e300, 1), "farther than")],
)  # fmt: skip
def test_odd_boxes(lo: tuple[float, ...], hi: tuple[float, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        EvidenceMap(0.1).crop_box(lo, hi)


def test_the_cell_that_has_too_little_is_named() -> None:
    grid = map_of({(3, -1): (2 * ONE, 5 * ONE)}, resolution=0.1)
    cases: tuple[tuple[Votes, str, str], ...] = (
        ({(3, -1): (3 * ONE, 0)}, r"\(0.35, -0.05\) m", "2 hits and 5 passes"),
        ({(900, 40): (0, ONE)}, r"\(90.05, 4.05\) m", "0 hits and 0 passes"),
    )
    for less, place, has in cases:
        with pytest.raises(InputError, match=f"{place} has {has}, the other"):
            grid.subtract(map_of(less, resolution=0.1))
    assert votes_of(grid) == {(3, -1): (2 * ONE, 5 * ONE)}


def test_what_was_subtracted_is_noted() -> None:
    grid, other = map_of({(0, 0): (ONE, 0)}), map_of({(0, 0): (ONE, 0)})
    grid.record("a.log")
    other.record("b.log")
    entries = (grid - other).provenance
    assert entries[0]["source"] == "a.log"
    assert [entry["source"] for entry in entries[1]["subtracted"]] == ["b.log"]


def test_lengths_add_up_and_are_taken_out() -> None:
    one, other = (EvidenceMap(0.5, votes="beam", path_lengths=True) for _ in "ab")
    for grid, length in ((one, 5), (other, 3)):
        assert grid.lengths is not None
        grid.lengths.add_cells(np.array([[1, 2]]), np.array([[0, length]]))
    total = one + other
    assert total.cell_lengths()[1].tolist() == [8]
    assert (total - other).cell_lengths()[1].tolist() == [5]
    with pytest.raises(InputError, match="does not hold"):
        other.subtract(one)
    with pytest.raises(InputError, match="keeps path lengths"):
        total.resample(1.0)
    assert total.resample(0.5).cell_lengths()[1].tolist() == [8]


def test_only_maps_of_one_kind() -> None:
    grid = EvidenceMap(0.05)
    for other, said in (
        (EvidenceMap(0.1), "resample the finer one to 0.1 m"),
        (EvidenceMap(0.07), "build one again"),
        (EvidenceMap(0.05, votes="beam"), "with the other's map.votes"),
        (EvidenceMap(0.05, ndim=3), "different ndim"),
        (EvidenceMap(0.05, half_life=3.0, t_ref_ns=5), "different half_life"),
        (EvidenceMap(0.05, sensor=ConeSensor(cone_deg=20.0), votes="scan"), "--any-sensor"),
    ):
        for do in (grid.merge, grid.subtract, lambda it: grid + it, lambda it: grid - it):
            with pytest.raises(InputError, match=said):
                do(other)
    fading = EvidenceMap(0.05, half_life=3.0, t_ref_ns=5)
    with pytest.raises(InputError, match=r"later map\.t_ref_ns"):
        fading.merge(EvidenceMap(0.05, half_life=3.0, t_ref_ns=6))
    for wrong in (1, "map", None):
        with pytest.raises(TypeError):
            grid + wrong
        with pytest.raises(TypeError):
            grid - wrong


@pytest.mark.parametrize(
    ("resolution", "said"),
    [(0.12, "give 0.1 or 0.15"), (0.0500001, "give 0.05 or 0.1"), (0.025, "cannot be split into"),
     (0.0, "side of a cell"), (math.nan, "side of a cell"), (math.inf, "side of a cell")],
)  # fmt: skip
def test_resolutions_that_are_no_multiple(resolution: float, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        EvidenceMap(0.05).resample(resolution)


def test_a_coarse_map_keeps_its_configuration_and_says_what_it_was() -> None:
    grid = EvidenceMap(
        0.05, votes="beam", sensor=BeamSensor(p_hit=0.8), posterior=PosteriorConfig(prior=0.3)
    )
    grid.record("a.log")
    coarse = grid.resample(0.15)
    assert coarse.resolution == 0.15
    assert (coarse.sensor, coarse.votes) == (grid.sensor, grid.votes)
    assert coarse.config.posterior == grid.config.posterior
    assert [entry.get("resampled_from") for entry in coarse.provenance] == [None, 0.05]
    assert grid.resample(0.05).provenance == grid.provenance


def test_a_sum_beyond_the_limit_is_refused() -> None:
    grid = map_of({(0, 0): (MAX_UNITS - 300 * ONE, 0), (1, 0): (MAX_UNITS - 300 * ONE, 0)})
    with pytest.raises(MapTooLargeError):
        grid.resample(0.5)


def test_cells_as_far_apart_as_they_may_be() -> None:
    """Tiles that no single number names."""
    reach = 1 << 45
    votes: Votes = dict.fromkeys(product((-reach, reach), repeat=3), (ONE, 0))
    grid = map_of(votes)
    assert votes_of(grid) == votes
    assert votes_of(grid + grid - grid) == votes
