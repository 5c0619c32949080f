# SPDX-License-Identifier: Apache-2.0
"""Information gain against its definition: all maps of short beams, all returns of long ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap
from oddsmap import ConfigError, InputError, Pose2, Pose3
from oddsmap.array_types import FloatArray
from oddsmap.query.gain import expected_gains
from oddsmap.query.places import Placed
from tests.kit import random_scans
from tests.kit3d import random_rotation, random_space_scans
from tests.naive.gains import by_cells, by_maps, by_returns, entropy_drop, information
from tests.naive.rays import cells_along

VOTES = 0.7, 0.4
MEASURES: dict[Any, Any] = {"information": information, "entropy": entropy_drop}
CHANCE = st.floats(1e-6, 1.0 - 1e-6)


class Cells(Placed):
    def __init__(self, ndim: int, resolution: float) -> None:
        self.ndim, self.resolution = ndim, resolution


def asked(
    known: Mapping[Any, float], pose: Any, ways: Any, reach: float, **options: Any
) -> FloatArray:
    """What each beam of one pose tells, in a map of nothing but probabilities."""
    d = np.shape(ways)[1]
    index = np.array(list(known), np.int64).reshape(-1, d)
    usual: dict[str, Any] = {
        "p_hit": VOTES[0], "p_miss": VOTES[1], "unknown": 0.5, "clear_range": None,
        "measure": "information", "threads": 1, "frame": None, "votes": "beam",
    }  # fmt: skip
    parts = [(index, np.array(list(known.values()), np.float64))]
    side = options.pop("resolution", 1.0)
    chosen = usual | options
    if chosen["votes"] == "scan":
        return expected_gains(Cells(d, side), parts, [pose], ways, reach, **chosen)
    rest = [np.asarray(ways)[i : i + 1] for i in range(len(ways))]
    one = [expected_gains(Cells(d, side), parts, [pose], way, reach, **chosen) for way in rest]
    return np.concatenate(one)


@given(
    cells=st.lists(CHANCE, min_size=1, max_size=7),
    reach=st.integers(1, 8),
    clear=st.integers(0, 8),
    votes=st.tuples(st.floats(0.51, 0.99), st.floats(0.01, 0.49)),
    measure=st.sampled_from(list(MEASURES)),
    backward=st.booleans(),
)
def test_the_mean_over_all_maps(
    cells: list[float], reach: int, clear: int, votes: Any, measure: Any, backward: bool
) -> None:
    """A beam along a row of cells, some of which lie beyond its reach, some in nothing known."""
    unknown, clear = 0.3, min(clear, reach)
    along = [*cells, *[unknown] * 8][:reach]
    known = {(-1 - i if backward else i, -3): p for i, p in enumerate(cells)}
    way = [-1.0 if backward else 1.0, 0.0]
    (found,) = asked(
        known, (0.0, -2.5, 0.0), [way], float(reach), p_hit=votes[0], p_miss=votes[1],
        unknown=unknown, clear_range=float(clear), measure=measure,
    )  # fmt: skip
    want = by_maps(along, clear, votes, MEASURES[measure])
    assert found == pytest.approx(want, rel=1e-9, abs=1e-12)
    assert by_returns(along, clear, votes, MEASURES[measure]) == pytest.approx(want, abs=1e-12)
    if measure == "information":
        assert found >= 0.0


@pytest.mark.parametrize("ndim", [2, 3])
@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), eighths=st.booleans())
def test_the_sum_over_all_returns(ndim: int, seed: int, eighths: bool) -> None:
    """Beams in all directions through cells of all sorts, across edges and corners, too."""
    rng = np.random.default_rng(seed)
    known = {
        cell: float(rng.choice([0.02, 0.1, 0.4, 0.9, 0.999]))
        for cell in np.ndindex(*(14,) * ndim)
        if rng.random() < 0.7
    }
    start = rng.uniform(3.0, 11.0, ndim)
    ways = rng.normal(size=(6, ndim))
    if eighths:
        start, ways = np.rint(start * 2) / 2, rng.integers(-2, 3, (6, ndim)).astype(float)
        ways[~ways.any(axis=1), 0] = 1.0
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    pose = Pose2(start[0], start[1], 0.0) if ndim == 2 else Pose3(np.eye(3), start)
    found = asked(known, pose, ways, 7.3, clear_range=4.6)
    once: dict[Any, tuple[float, float]] = {}
    for gain, way in zip(found, ways, strict=True):
        along = [*cells_along(start.tolist(), way.tolist(), 7.3)]
        ends: list[Any] = [*[s for s, _ in along[1:]], 7.3]
        # A corner that is met to within rounding is no cell: it may have no length in one.
        along = [
            (s, cell)
            for (s, cell), end in zip(along, ends, strict=True)
            if float(end) - float(s) > 2.0**-25
        ]
        chances = [known.get(cell, 0.5) for _, cell in along]
        cleared = sum(float(s) < 4.6 for s, _ in along)
        assert gain == pytest.approx(by_returns(chances, cleared, VOTES, information), rel=1e-9)
        each = by_cells(chances, cleared, VOTES, information)
        assert sum(told for _, told in each) == pytest.approx(gain, rel=1e-9)
        for (_, cell), (arrives, told) in zip(along, each, strict=True):
            if cell not in once or arrives > once[cell][0]:
                once[cell] = arrives, told
    (whole,) = asked(known, pose, ways, 7.3, clear_range=4.6, votes="scan")
    assert whole == pytest.approx(sum(told for _, told in once.values()), rel=1e-6)
    assert whole <= found.sum() * (1.0 + 1e-9)


@cache
def grid(ndim: int) -> oddsmap.EvidenceMap:
    return oddsmap.build_map(scans_of(ndim), 0.25, votes="beam")


def scans_of(ndim: int) -> list[oddsmap.Scan]:
    return random_scans(1, 8) if ndim == 2 else random_space_scans(1, 8)


def stands(ndim: int, count: int) -> list[Any]:
    rng = np.random.default_rng(4)
    if ndim == 2:
        return [Pose2(*rng.uniform(-4.0, 4.0, 3)) for _ in range(count)]
    return [Pose3(random_rotation(rng), rng.uniform(-4.0, 4.0, 3)) for _ in range(count)]


def fan(ndim: int, count: int) -> FloatArray:
    ways = np.random.default_rng(5).normal(size=(count, ndim))
    return np.asarray(ways / np.linalg.norm(ways, axis=1)[:, None])


def naive(view: Any, pose: Any, ways: FloatArray, reach: float, unknown: float) -> float:
    """Beam by beam, cell by cell."""
    total = 0.0
    for way in ways @ pose.rotation.T:
        start = (pose.translation / view.resolution).tolist()
        along = [cell for _, cell in cells_along(start, way.tolist(), reach / view.resolution)]
        centre = grid(len(start)).centre_of(along)
        p = view.at(centre)
        seen = view.states_at(centre).state != oddsmap.State.UNKNOWN
        chances = np.where(seen, p, unknown).tolist()
        total += by_returns(chances, len(chances), VOTES, information)
    return total


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("name", ["log odds", "reflection", "map without counts"])
def test_all_kinds_of_maps(name: str, ndim: int) -> None:
    view: Any = grid(ndim).log_odds()
    options: dict[str, Any] = {"unknown": 0.2, "p_hit": VOTES[0], "p_miss": VOTES[1]}
    if name == "reflection":
        view = grid(ndim).reflection()
    elif name != "log odds":
        view = view.to_probability_map() if ndim == 2 else view.to_voxels()
    poses, ways = stands(ndim, 3), fan(ndim, 10)
    found = view.information_gain(poses, ways, 5.0, **options)
    want = [naive(view, pose, ways, 5.0, 0.2) for pose in poses]
    assert found == pytest.approx(want, rel=1e-9)


def test_a_map_that_lies_askew() -> None:
    plane = grid(2).log_odds().to_probability_map()
    turn, shift = Pose2(0.0, 0.0, 0.7), Pose2(3.0, -2.0, 0.7)
    corner = turn.transform(np.array([plane.origin]))[0] + [3.0, -2.0]
    askew = oddsmap.ProbabilityMap(
        plane.probability, plane.observed, plane.resolution, (corner[0], corner[1]), 0.7
    )
    poses, ways = stands(2, 5), fan(2, 20)
    straight = plane.information_gain(poses, ways, 5.0, p_hit=0.7, p_miss=0.4)
    turned = askew.information_gain(
        [shift @ pose for pose in poses], ways, 5.0, p_hit=0.7, p_miss=0.4
    )
    assert turned == pytest.approx(straight, rel=1e-6)


@pytest.mark.parametrize("ndim", [2, 3])
def test_what_a_view_knows_is_what_it_is_by_default(ndim: int) -> None:
    view = grid(ndim).log_odds(p_hit=0.9, p_miss=0.3, prior=0.2)
    poses, ways = stands(ndim, 40), fan(ndim, 30)
    found = view.information_gain(poses, ways, 5.0)
    said = view.information_gain(poses, ways, 5.0, p_hit=0.9, p_miss=0.3, unknown=0.2)
    assert np.array_equal(found, said)
    threaded = view.information_gain(poses * 30, ways, 5.0, threads=3)
    assert np.array_equal(threaded, np.tile(found, 30))
    alone = [view.information_gain([pose], ways, 5.0)[0] for pose in poses]
    assert np.array_equal(found, alone)
    evidence = oddsmap.build_map(scans_of(ndim), 0.25)
    assert evidence.votes == "scan"
    by_scan = evidence.log_odds().information_gain(poses, ways, 5.0)
    said = evidence.log_odds().information_gain(poses, ways, 5.0, votes="scan", threads=2)
    assert np.array_equal(by_scan, said)
    assert (by_scan < evidence.log_odds().information_gain(poses, ways, 5.0, votes="beam")).all()
    matrices = np.stack([_matrix(pose) for pose in poses])
    assert np.allclose(view.information_gain(matrices, ways, 5.0), found, rtol=1e-9)
    assert view.information_gain([], ways, 5.0).shape == (0,)
    assert view.information_gain(poses, fan(ndim, 0), 5.0).tolist() == [0.0] * 40


def _matrix(pose: Any) -> FloatArray:
    d = len(pose.translation)
    matrix = np.eye(d + 1)
    matrix[:d, :d], matrix[:d, d] = pose.rotation, pose.translation
    return matrix


def test_where_all_is_known_little_is_to_be_learnt() -> None:
    """Mapped 50 times, a place tells less than the edge of the map; cells of p 0 or 1 nothing."""
    scan = oddsmap.Scan.from_angles((0.0, 0.0, 0.0), np.linspace(-3.1, 3.1, 200), np.full(200, 3.0))
    view = oddsmap.build_map([scan] * 50, 0.1).log_odds()
    gains = view.information_gain([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]], scan.directions, 3.0)
    assert gains[0] < 0.01 * gains[1]
    sure = oddsmap.ProbabilityMap(np.tile([0.0, 1.0], (1, 1)), np.ones((1, 2), bool), 1.0)
    told = sure.information_gain([[0.5, 0.5, 0.0]], [[1.0, 0.0]], 5.0, p_hit=0.7, p_miss=0.4)
    assert told.tolist() == [0.0]


def test_entropy_may_rise() -> None:
    """A cell taken for free that returns a beam is less certain than before."""
    (drop,) = asked({(0, 0): 0.2}, (0.5, 0.5, 0.0), [[1.0, 0.0]], 0.5, p_hit=0.8, p_miss=0.499999,
                    measure="entropy")  # fmt: skip
    assert drop < 0.0


BASE: dict[str, Any] = {"poses": [[0.0, 0.0, 0.0]], "directions": [[1.0, 0.0]], "max_range": 5.0}


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        ({"poses": np.zeros(3)}, InputError, "poses are a list"),
        ({"poses": Pose2(0.0, 0.0, 0.0)}, InputError, "poses are a list"),
        ({"poses": 3.0}, InputError, "poses are a list"),
        ({"poses": [0.0, 0.0, 0.0]}, InputError, "poses are a list"),
        ({"poses": [np.eye(4)]}, InputError, "pose 0 is none of a 2D map"),
        ({"poses": [[math.nan, 0.0, 0.0]]}, InputError, "no cell"),
        ({"poses": [[0.0, 0.0, math.nan]]}, InputError, "not finite"),
        ({"directions": [[1.0, 1.0]]}, InputError, "not of length 1"),
        ({"directions": [[1.0, 0.0, 0.0]]}, InputError, "directions of a 2D map"),
        ({"max_range": math.inf}, ConfigError, "max_range is a length"),
        ({"clear_range": 6.0}, ConfigError, "up to max_range"),
        ({"p_hit": 0.4}, ConfigError, "p_miss < 0.5 < p_hit"),
        ({"unknown": 0.0}, ConfigError, "unknown is a probability"),
        ({"votes": "cell"}, ConfigError, 'votes is "scan" or "beam"'),
        ({"max_range": 1e6}, ConfigError, "at most 524288 cells"),
        ({"measure": "bits"}, ConfigError, "measure is"),
        ({"threads": 0}, ConfigError, "threads"),
    ],
)
def test_what_is_refused(change: dict[str, Any], error: Any, says: str) -> None:
    with pytest.raises(error, match=says):
        grid(2).log_odds().information_gain(**BASE | change)


def test_what_a_map_has_to_be_told() -> None:
    with pytest.raises(ConfigError, match="give p_hit and p_miss"):
        grid(2).reflection().information_gain(**BASE)
    prior = grid(2).log_odds(prior=oddsmap.build_map(random_scans(2, 3), 0.25))
    with pytest.raises(ConfigError, match="give unknown"):
        prior.information_gain(**BASE)
    assert prior.information_gain(**BASE, unknown=0.5) > 0.0
