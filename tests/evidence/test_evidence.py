# SPDX-License-Identifier: Apache-2.0
"""The map against a plain dictionary: whatever is done to it, in whatever order."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from oddsmap import BeamSensor, ConeSensor, EvidenceMap, add_scans
from oddsmap.config.config import PosteriorConfig
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.kernels.units import MAX_UNITS
from tests.kit import ONE, Votes, add_votes, random_scans, votes_of

coordinate = st.one_of(st.integers(-40, 40), st.integers(-1100, 1100))
cell = st.tuples(coordinate, coordinate)
weight = st.one_of(
    st.sampled_from([0, ONE, 7 * ONE, 255 * ONE, 256 * ONE]), st.integers(0, 3 * ONE)
)
some_votes = st.dictionaries(cell, st.tuples(weight, weight), max_size=8)
sides = st.sampled_from([1, 5, 8, 32, 33])


def known(votes: Votes) -> Votes:
    return {at: vote for at, vote in votes.items() if vote != (0, 0)}


def total(one: Votes, other: Votes) -> Votes:
    none = (0, 0)
    return {
        at: (
            one.get(at, none)[0] + other.get(at, none)[0],
            one.get(at, none)[1] + other.get(at, none)[1],
        )
        for at in one.keys() | other.keys()
    }


class MapAgainstDictionary(RuleBasedStateMachine):
    """Adding, mapping, merging, cropping, saving and loading."""

    @initialize(side=sides, votes=st.sampled_from(["scan", "beam"]))
    def start(self, side: int, votes: str) -> None:
        self.folder = Path(tempfile.mkdtemp())
        self.map = EvidenceMap(0.25, votes=votes, tile_side=side)
        self.want: Votes = {}

    @rule(votes=some_votes)
    def add_cells(self, votes: Votes) -> None:
        add_votes(self.map, votes)
        self.want = total(self.want, votes)

    @rule(seed=st.integers(0, 50), times=st.sampled_from([1, 2, 300]))
    def integrate(self, seed: int, times: int) -> None:
        scan = random_scans(seed, 1, beams=12, reach=3.0)[0]
        once = EvidenceMap(0.25, votes=self.map.votes)
        add_scans(once, [scan])
        add_scans(self.map, [scan] * times)
        many = {at: (times * hit, times * free) for at, (hit, free) in votes_of(once).items()}
        self.want = total(self.want, many)

    @rule(votes=some_votes, side=sides)
    def merge(self, votes: Votes, side: int) -> None:
        other = EvidenceMap(0.25, votes=self.map.votes, tile_side=side)
        add_votes(other, votes)
        self.map.merge(other)
        self.want = total(self.want, votes)
        assert votes_of(other) == known(votes)

    @rule()
    def merge_with_itself(self) -> None:
        self.map.merge(self.map)
        self.want = total(self.want, self.want)

    @rule(lo=cell, size=st.tuples(st.integers(0, 900), st.integers(0, 900)))
    def crop(self, lo: tuple[int, int], size: tuple[int, int]) -> None:
        hi = (lo[0] + size[0], lo[1] + size[1])
        inside = {
            at: vote
            for at, vote in known(self.want).items()
            if lo[0] <= at[0] < hi[0] and lo[1] <= at[1] < hi[1]
        }
        part = self.map.crop(lo, hi)
        assert votes_of(part) == inside
        if inside:
            self.map, self.want = part, inside

    @rule()
    def save_and_load(self) -> None:
        path = self.folder / "map.zarr"
        self.map.save(path, force=True)
        again = EvidenceMap.load(path)
        assert again.config == self.map.config
        assert again.provenance == self.map.provenance
        self.map = again

    @invariant()
    def same_cells(self) -> None:
        if not hasattr(self, "map"):
            return
        want = known(self.want)
        assert votes_of(self.map) == want
        assert self.map.cell_count() == len(want)
        bounds = self.map.bounds()
        if not want:
            assert bounds is None
            return
        assert bounds is not None
        places = np.array(list(want))
        assert bounds[0].tolist() == places.min(axis=0).tolist()
        assert bounds[1].tolist() == (places.max(axis=0) + 1).tolist()

    def teardown(self) -> None:
        if hasattr(self, "folder"):
            shutil.rmtree(self.folder)


TestMapAgainstDictionary = MapAgainstDictionary.TestCase
TestMapAgainstDictionary.settings = settings(max_examples=20, stateful_step_count=12)


@given(some_votes, sides, cell, st.tuples(st.integers(0, 90), st.integers(0, 90)))
def test_a_region_holds_the_cells(
    votes: Votes, side: int, lo: tuple[int, int], size: tuple[int, int]
) -> None:
    evidence = EvidenceMap(1.0, tile_side=side)
    add_votes(evidence, votes)
    hits, passes = evidence.region_units(lo, (lo[0] + size[0], lo[1] + size[1]))
    assert hits.shape == passes.shape == size[::-1]
    for (x, y), vote in votes.items():
        if lo[0] <= x < lo[0] + size[0] and lo[1] <= y < lo[1] + size[1]:
            at = (y - lo[1], x - lo[0])
            assert (hits[at], passes[at]) == vote
            hits[at] = passes[at] = 0
    assert not hits.any()
    assert not passes.any()


@pytest.mark.parametrize("side", [1, 3, 8])
def test_space(side: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    places = np.unique(rng.integers(-100, 100, (25, 3)) * (2, 1, 1), axis=0)
    evidence = EvidenceMap(0.1, ndim=3, tile_side=side)
    hits, passes = rng.integers(0, 5 * ONE, (2, len(places)))
    evidence.add_cells(places, hits, passes)
    evidence.save(tmp_path / "space.zarr")
    for twin in (evidence, evidence.load(tmp_path / "space.zarr")):
        index, got_hits, got_passes = twin.cells()
        order = np.lexsort(places.T)
        assert (index == places[order]).all()
        assert (got_hits == hits[order]).all()
        assert (got_passes == passes[order]).all()
        box = twin.region_units((-200, -75, -50), (200, 75, 50))
        assert box[0].shape == (100, 150, 400)
        x, y, z = places.T
        inside = (abs(y + 0.5) < 75) & (abs(z + 0.5) < 50)
        assert (box[0][z[inside] + 50, y[inside] + 75, x[inside] + 200] == hits[inside]).all()
        assert int(box[0].sum()) == int(hits[inside].sum())


near = st.integers(-20, 20)
space_cell = st.tuples(near, near, near)
space_votes = st.dictionaries(space_cell, st.tuples(weight, weight), max_size=8)


@given(space_votes, space_votes, sides, sides, space_cell, st.tuples(*[st.integers(0, 30)] * 3))
def test_space_against_a_dictionary(
    votes: Votes,
    others: Votes,
    side: int,
    other_side: int,
    lo: tuple[int, int, int],
    size: tuple[int, int, int],
) -> None:
    """Adding, merging, cropping and looking at a box."""
    evidence, other = (EvidenceMap(0.5, ndim=3, tile_side=n) for n in (side, other_side))
    add_votes(evidence, votes)
    add_votes(other, others)
    evidence.merge(other)
    want = known(total(votes, others))
    assert votes_of(evidence) == want
    assert evidence.cell_count() == len(want)
    if want:
        bounds = evidence.bounds()
        assert bounds is not None
        places = np.array(list(want))
        assert (bounds[0] == places.min(axis=0)).all()
        assert (bounds[1] == places.max(axis=0) + 1).all()
    hi = tuple(a + n for a, n in zip(lo, size, strict=True))
    inside = {
        at: vote
        for at, vote in want.items()
        if all(a <= i < b for i, a, b in zip(at, lo, hi, strict=True))
    }
    assert votes_of(evidence.crop(lo, hi)) == inside
    hits, passes = evidence.region_units(lo, hi)
    assert hits.shape == passes.shape == size[::-1]
    for (x, y, z), vote in inside.items():
        at = (z - lo[2], y - lo[1], x - lo[0])
        assert (hits[at], passes[at]) == vote
        hits[at] = passes[at] = 0
    assert not hits.any()
    assert not passes.any()


def test_cells_are_sorted_x_fastest() -> None:
    evidence = EvidenceMap(1.0)
    add_votes(evidence, {(5, -1): (ONE, 0), (-50, 3): (ONE, 0), (4, -1): (ONE, 0), (0, 0): (0, 1)})
    assert evidence.cells()[0].tolist() == [[4, -1], [5, -1], [0, 0], [-50, 3]]


def test_an_empty_map() -> None:
    evidence = EvidenceMap(1.0)
    index, hits, passes = evidence.cells()
    assert (index.shape, hits.shape, passes.shape) == ((0, 2), (0,), (0,))
    assert evidence.bounds() is None
    assert evidence.region((0, 0), (3, 2))[0].tolist() == [[0.0] * 3] * 2
    assert evidence.region((0, 0), (0, 0))[0].shape == (0, 0)
    evidence.add_cells(np.empty((0, 2), np.int64), np.empty(0, np.int64), np.empty(0, np.int64))
    assert evidence.cell_count() == 0


def ints(*values: int) -> npt.NDArray[np.int64]:
    return np.array(values, np.int64)


@pytest.mark.parametrize(
    ("index", "hits", "passes"),
    [
        (ints(1, 2), ints(1), ints(1)),
        (np.ones((2, 3), np.int64), ints(1, 1), ints(1, 1)),
        (np.eye(2, dtype=np.int64), ints(1), ints(1, 1)),
        (np.eye(2, dtype=np.int64), ints(1, 1), ints(1)),
        (np.eye(2, dtype=np.int64), ints(1), ints(1)),
        (np.eye(2, dtype=np.int64), ints(1, -1), ints(1, 1)),
        (np.eye(2, dtype=np.int64), ints(1, 1), ints(-1, 1)),
    ],
)
def test_add_cells_refuses(
    index: npt.NDArray[np.int64], hits: npt.NDArray[np.int64], passes: npt.NDArray[np.int64]
) -> None:
    evidence = EvidenceMap(1.0)
    with pytest.raises(InputError):
        evidence.add_cells(index, hits, passes)
    assert evidence.cell_count() == 0


def test_overflow_changes_nothing() -> None:
    evidence = EvidenceMap(1.0)
    votes: Votes = {(0, 0): (MAX_UNITS - 300 * ONE, 5), (3, 3): (ONE, ONE)}
    add_votes(evidence, votes)
    for more in (MAX_UNITS, 300 * ONE, 46 * ONE):
        with pytest.raises(MapTooLargeError, match=r"2\^46"):
            add_votes(evidence, {(0, 0): (more, 0), (100, 100): (ONE, 0)})
        assert votes_of(evidence) == votes
    with pytest.raises(MapTooLargeError):
        evidence.merge(evidence)
    assert votes_of(evidence) == votes


@pytest.mark.parametrize(
    ("lo", "hi"),
    [((0, 0, 0), (1, 1, 1)), ((0, 0), (1, 1, 1)), (0, 1), ((2, 2), (1, 3)), ((0, 1), (1, 0))],
)
def test_odd_boxes_are_refused(lo: tuple[int, ...], hi: tuple[int, ...]) -> None:
    evidence = EvidenceMap(1.0)
    for method in (evidence.region, evidence.region_units, evidence.crop):
        with pytest.raises(InputError, match="needs lo <= hi of 2 indices"):
            method(lo, hi)


def test_merge_refuses_other_frames() -> None:
    evidence = EvidenceMap(0.5)
    for name, other in {
        "resolution": EvidenceMap(0.25),
        "votes": EvidenceMap(0.5, votes="beam"),
        "ndim": EvidenceMap(0.5, ndim=3),
    }.items():
        add = np.zeros((1, other.ndim), np.int64)
        other.add_cells(add, ints(ONE), ints(0))
        with pytest.raises(InputError, match=f"different {name}"):
            evidence.merge(other)
    assert evidence.cell_count() == 0


def test_merge_keeps_both_provenances() -> None:
    one, other = EvidenceMap(1.0), EvidenceMap(1.0)
    one.record("a/one.log", scans=1)
    other.record("b/other.log", scans=2)
    one.merge(other)
    assert [entry["source"] for entry in one.provenance] == ["one.log", "other.log"]
    assert [entry["source"] for entry in other.provenance] == ["other.log"]


def test_like_and_crop_keep_the_configuration() -> None:
    evidence = EvidenceMap(
        0.3,
        votes="beam",
        sensor=BeamSensor(p_hit=0.8),
        posterior=PosteriorConfig(prior=0.3),
        tile_side=7,
    )
    for twin in (evidence.like(), evidence.crop((0, 0), (1, 1))):
        assert twin.config == evidence.config
        assert (twin.tiles.side, twin.ndim) == (7, 2)


def test_odd_dimensions_are_refused() -> None:
    for ndim in (0, 1, 4):
        with pytest.raises(ConfigError, match="2 or 3 dimensions"):
            EvidenceMap(1.0, ndim=ndim)
    for side in (-1, 2000):
        with pytest.raises(ConfigError, match="tiles need"):
            EvidenceMap(1.0, tile_side=side)


def test_maps_of_different_kinds_of_sensor_do_not_merge_by_themselves() -> None:
    beams, cones = (
        EvidenceMap(0.1, votes="beam"),
        EvidenceMap(0.1, sensor=ConeSensor(cone_deg=20.0)),
    )
    cones.add_cells(np.array([[1, 1]]), np.array([ONE]), np.array([0]))
    with pytest.raises(InputError, match="kind cone is not added to one of kind beam"):
        beams.merge(cones)
    assert beams.cell_count() == 0
    beams.merge(cones, any_sensor=True)
    assert beams.cell_count() == 1
