# SPDX-License-Identifier: Apache-2.0
"""Points in metres: what views answer is what their regions hold, and rays end where these say."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import ConfigError, InputError, RayHits, State, Thresholds
from oddsmap.array_types import FloatArray
from oddsmap.query.places import Placed
from tests.kit import random_scans
from tests.kit3d import random_space_scans
from tests.naive.rays import first_met

RESOLUTION = 0.25
NAMES = ["log odds", "with a prior map", "reflection", "full map", "reflection map"]


@cache
def evidence(ndim: int) -> oddsmap.EvidenceMap:
    return oddsmap.build_map(scans(ndim), RESOLUTION, votes="beam")


def scans(ndim: int) -> list[oddsmap.Scan]:
    return random_scans(1, 12) if ndim == 2 else random_space_scans(1, 12)


@cache
def view_of(name: str, ndim: int) -> Any:
    grid = evidence(ndim)
    if name == "log odds":
        return grid.log_odds()
    if name == "with a prior map":
        older = oddsmap.build_map(scans(ndim)[:3], RESOLUTION, votes="beam")
        return grid.log_odds(prior=older, clamp=(0.05, 0.9))
    if name == "reflection":
        return grid.reflection()
    sensor = oddsmap.ConeSensor(cone_deg=15.0, range_max=4.0)
    build = oddsmap.build_full_map if name == "full map" else oddsmap.build_reflection_map
    return build(scans(ndim)[:2], RESOLUTION, sensor=sensor)


def places(ndim: int, count: int = 500) -> FloatArray:
    """Points inside and outside what was seen, some on borders of cells."""
    rng = np.random.default_rng(5)
    points = rng.uniform(-14.0, 14.0, (count, ndim))
    points[::2] /= 4.0
    points[::5] = np.rint(points[::5] / RESOLUTION) * RESOLUTION
    return points


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("name", NAMES)
def test_points_have_what_regions_hold(name: str, ndim: int) -> None:
    view, points = view_of(name, ndim), places(ndim)
    cells = view.cell_of(points)
    assert np.array_equal(cells, np.floor(points / RESOLUTION).astype(np.int64))
    box = np.full(ndim, -60), np.full(ndim, 60)
    where = tuple((cells - box[0]).T[::-1])
    beta = name.startswith("reflection")
    p = (view.mean if beta else view.probability)(box)[where]
    assert np.array_equal(view.at(points), p)
    found = view.states_at(points)
    assert np.array_equal(found.probability, p)
    assert np.array_equal(found.state, view.state(box)[where])
    assert np.array_equal(found.cell, cells)
    assert State.UNKNOWN in found.state
    assert len(set(found.state.tolist())) > 1
    assert (found.interval is not None) == beta
    if beta:
        for end, want in zip(found.interval, view.interval(box), strict=True):
            assert np.array_equal(end, want[where])
    if name == "full map":
        assert found.hits is None
        assert found.passes is None
    elif name != "reflection map":
        hits, passes = evidence(ndim).region(*box)
        assert np.array_equal(found.hits, hits[where])
        assert np.array_equal(found.passes, passes[where])


@pytest.mark.parametrize("ndim", [2, 3])
def test_nothing_seen_is_the_prior_however_far(ndim: int) -> None:
    far = np.full((1, ndim), 1e12)
    assert evidence(ndim).log_odds(prior=0.3).at(far) == pytest.approx(0.3)
    assert evidence(ndim).reflection(a=1.0, b=3.0).at(far) == pytest.approx(0.25)
    assert view_of("full map", ndim).at(far) == pytest.approx(view_of("full map", ndim).prior)
    assert evidence(ndim).log_odds().states_at(far).state.tolist() == [State.UNKNOWN]


def test_maps_without_counts() -> None:
    voxels, points = evidence(3).log_odds().to_voxels(), places(3)
    of_view = evidence(3).log_odds().states_at(points)
    found = voxels.states_at(points)
    known = found.state != State.UNKNOWN
    assert np.array_equal(found.state, of_view.state)
    assert np.array_equal(voxels.at(points)[known], of_view.probability[known])
    assert np.isnan(voxels.at(points)[~known]).all()
    plane, points = evidence(2).log_odds().to_probability_map(), places(2)
    first = np.rint(np.array(plane.origin) / RESOLUTION).astype(np.int64)
    inside = ~np.isnan(plane.at(points))
    assert 0 < np.count_nonzero(inside) < len(points)
    assert np.array_equal(plane.cell_of(points), evidence(2).cell_of(points) - first)
    assert np.array_equal(plane.at(points)[inside], evidence(2).log_odds().at(points)[inside])
    assert np.array_equal(
        plane.states_at(points).state, evidence(2).log_odds().states_at(points).state
    )


@pytest.mark.parametrize("ndim", [2, 3])
def test_cells_and_their_centres(ndim: int) -> None:
    grid = evidence(ndim)
    cells = np.random.default_rng(0).integers(-(1 << 40), 1 << 40, (100, ndim))
    assert np.array_equal(grid.cell_of(grid.centre_of(cells)), cells)
    assert grid.cell_of(np.full((1, ndim), 0.75)).tolist() == [[3] * ndim]
    assert grid.cell_of([[-1e-9] * ndim]).tolist() == [[-1] * ndim]
    assert grid.cell_of([]).shape == grid.centre_of([]).shape == (0, ndim)
    assert grid.log_odds().at([]).shape == (0,)
    with pytest.raises(InputError, match="whole numbers"):
        grid.centre_of(np.zeros((1, ndim)))


@pytest.mark.parametrize("ndim", [2, 3])
def test_the_region_of_a_box_has_the_cells_whose_centres_lie_in_it(ndim: int) -> None:
    view = evidence(ndim).log_odds()
    lo, hi = np.array([-1.1, 0.0, 0.3])[:ndim], np.array([0.13, 2.0, 0.9])[:ndim]
    first, past = view.region_of(lo, hi)
    every = np.indices((30,) * ndim).reshape(ndim, -1).T - 15
    centres = view.centre_of(every)
    inside = ((centres >= lo) & (centres < hi)).all(axis=1)
    assert np.array_equal(((every >= first) & (every < past)).all(axis=1), inside)
    box = evidence(ndim).crop_box(lo, hi)
    region = view.region_of(lo, hi)
    assert np.array_equal(view.probability(region), box.log_odds().probability(region))
    if ndim == 2:
        plane = view.to_probability_map()
        low, high = plane.region_of(lo, hi)
        assert np.allclose(plane.centre_of([low, high]), view.centre_of([first, past]))
        turned = oddsmap.ProbabilityMap(plane.probability, plane.observed, RESOLUTION, yaw=0.1)
        with pytest.raises(InputError, match=r"turned by 0.1 rad"):
            turned.region_of(lo, hi)


class Plain(Placed):
    ndim, resolution = 2, 0.5


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[0.0, 1.0], [math.nan, 0.0]], "1 of 2 points have no cell, the first is point 1"),
        ([[math.inf, 0.0]], "must be finite"),
        ([[1e15, 0.0]], "within 2.46 cells"),
        ([1.0, 2.0], r"shape \(n, 2\), x first, got \(2,\) \(one alone is \[point\]\)"),
        ([[1.0, 2.0, 3.0]], r"got \(1, 3\)"),
        ([[1.0], [2.0, 3.0]], "real numbers"),
        ([["a", "b"]], "real numbers"),
        ([[True, False]], "real numbers"),
    ],
)
def test_points_that_are_refused(points: Any, message: str) -> None:
    for ask in (Plain().cell_of, evidence(2).log_odds().at, evidence(2).log_odds().states_at):
        with pytest.raises(InputError, match=message):
            ask(points)


def fan(ndim: int, count: int, seed: int = 2) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(count, ndim))
    return rng.uniform(-9.0, 9.0, (count, ndim)), ways / np.linalg.norm(ways, axis=1)[:, None]


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("until", ["occupied", "unknown", ("occupied", "unknown")])
def test_rays_end_where_states_say(name: str, ndim: int, until: Any) -> None:
    view = view_of(name, ndim)
    origins, ways = fan(ndim, 40)
    states = known_states(view)
    names = (until,) if isinstance(until, str) else until
    stop = {int(State[each.upper()]) for each in names}
    found = view.cast_rays(origins, ways, 12.0, until=until)
    for i in range(len(ways)):
        want = first_met(
            states, stop, (origins[i] / RESOLUTION).tolist(), ways[i].tolist(), 12.0 / RESOLUTION
        )
        assert found.met[i] == (want is not None)
        if want is None:
            assert found.ended_by[i] == RayHits.MAX_RANGE
            assert found.cell[i].tolist() == [RayHits.NO_CELL] * ndim
        else:
            assert (tuple(found.cell[i].tolist()), found.ended_by[i]) == want[1:]
            assert found.distance[i] == pytest.approx(float(want[0]) * RESOLUTION, abs=1e-9)


def known_states(view: Any) -> dict[tuple[int, ...], int]:
    lo, hi = view.bounds()
    state = view.state((lo, hi))
    where = np.argwhere(state != State.UNKNOWN)
    return dict(
        zip(
            map(tuple, (where[:, ::-1] + lo).tolist()),
            state[tuple(where.T)].tolist(),
            strict=True,
        )
    )


def test_rays_by_other_thresholds_and_as_of_then() -> None:
    grid = oddsmap.EvidenceMap(0.5)
    one = np.array([1 << 16])
    grid.add_cells(np.array([[4, 0]]), one, 0 * one)
    view = grid.log_odds()
    caster = view.ray_caster()
    ray: tuple[Any, Any] = [[0.25, 0.25]], [[1.0, 0.0]]
    assert view.cast_rays(*ray, 9.0).distance.tolist() == [1.75]
    strict = Thresholds(0.1, 0.9)
    assert not view.cast_rays(*ray, 9.0, thresholds=strict).met.any()
    assert view.cast_rays(*ray, 9.0, until="undecided", thresholds=strict).met.all()
    # A cell is met if the ray has a length in it.
    assert not view.cast_rays(*ray, 1.75).met.any()
    assert view.cast_rays(*ray, math.nextafter(1.75, 2.0)).met.all()
    grid.add_cells(np.array([[2, 0]]), one, 0 * one)
    assert caster.cast(*ray, 9.0).distance.tolist() == [1.75]
    assert view.cast_rays(*ray, 9.0).distance.tolist() == [0.75]
    assert view.cast_rays([[2.25, 0.25]], ray[1], 9.0).distance.tolist() == [0.0]


@pytest.mark.parametrize("ndim", [2, 3])
def test_threads_and_one_origin_for_all(ndim: int) -> None:
    caster = view_of("log odds", ndim).ray_caster()
    origins, ways = fan(ndim, 40_000)
    one, two = (caster.cast(origins, ways, 20.0, threads=n) for n in (1, 2))
    for name in ("distance", "cell", "ended_by"):
        assert np.array_equal(getattr(one, name), getattr(two, name))
    same = caster.cast(origins[0], ways[:100], 20.0)
    assert np.array_equal(
        same.distance, caster.cast(np.tile(origins[0], (100, 1)), ways[:100], 20.0).distance
    )


def test_a_turned_map_gives_turned_answers() -> None:
    """A ROS map may lie askew: cells count from its corner, along its own axes."""
    plane = evidence(2).log_odds().to_probability_map()
    yaw, shift = 0.7, np.array([30.0, -5.0])
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    corner = turn @ np.array(plane.origin) + shift
    askew = oddsmap.ProbabilityMap(
        plane.probability, plane.observed, plane.resolution, (corner[0], corner[1]), yaw
    )
    origins, ways = fan(2, 300)
    points = origins @ turn.T + shift
    assert np.array_equal(plane.cell_of(origins), askew.cell_of(points))
    assert np.array_equal(plane.at(origins), askew.at(points), equal_nan=True)
    assert np.allclose(askew.centre_of(askew.cell_of(points)), points, atol=RESOLUTION)
    straight = plane.cast_rays(origins, ways, 12.0)
    turned = askew.cast_rays(points, ways @ turn.T, 12.0)
    assert np.array_equal(straight.cell, turned.cell)
    assert np.allclose(straight.distance[straight.met], turned.distance[turned.met])


def test_rays_of_voxels_are_those_of_their_view() -> None:
    view = evidence(3).log_odds()
    origins, ways = fan(3, 300)
    for until in ("occupied", "unknown"):
        one = view.cast_rays(origins, ways, 12.0, until=until)
        other = view.to_voxels().cast_rays(origins, ways, 12.0, until=until)
        assert np.array_equal(one.cell, other.cell)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"directions": [[2.0, 0.0]]}, InputError, "not of length 1.*length 2: divide"),
        ({"directions": [[0.0, 0.0]]}, InputError, "1 of 1 directions"),
        ({"directions": [[math.nan, 0.0]]}, InputError, "1 of 1 directions"),
        ({"origins": [[math.nan, 0.0]]}, InputError, "no cell"),
        ({"origins": [[0.0, 0.0]] * 2}, InputError, "2 origins and 1 directions"),
        ({"origins": [[0.0, 0.0, 0.0]]}, InputError, "origins of a 2D map"),
        ({"max_range": 0.0}, ConfigError, "length above 0"),
        ({"max_range": math.nan}, ConfigError, "length above 0"),
        ({"until": "wall"}, ConfigError, "one or several of occupied, unknown"),
        ({"until": ()}, ConfigError, "one or several"),
        ({"threads": 0}, ConfigError, "at least 1"),
    ],
)
def test_rays_that_are_refused(change: dict[str, Any], error: Any, message: str) -> None:
    call = {"origins": [[0.0, 0.0]], "directions": [[1.0, 0.0]], "max_range": 5.0, **change}
    with pytest.raises(error, match=message):
        evidence(2).log_odds().cast_rays(**call)


def test_reflectivity_is_not_decided_by_thresholds() -> None:
    view = evidence(2).reflection()
    for ask in (
        lambda: view.states_at([[0.0, 0.0]], thresholds=Thresholds()),
        lambda: view.cast_rays([[0.0, 0.0]], [[1.0, 0.0]], 5.0, thresholds=Thresholds()),
    ):
        with pytest.raises(ConfigError, match="its own threshold"):
            ask()


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("name", NAMES)
def test_every_view_predicts_readings_and_scores_poses(name: str, ndim: int) -> None:
    view, (origins, ways) = view_of(name, ndim), fan(ndim, 20)
    sensor = oddsmap.BeamSensor(range_max=6.0)
    found = view.range_distribution(origins, ways, sensor)
    whole = found.probability.sum(axis=1) + found.no_return + found.no_information
    assert whole == pytest.approx(np.ones(20))
    expected = view.expected_ranges(origins, ways, sensor)
    assert ((expected > 0.0) & (expected <= 6.0)).all()
    scan = scans(ndim)[0]
    for model in (view.likelihood_field(6.0), view.beam_likelihood(6.0)):
        assert np.isfinite(model.log_likelihood([scan.map_from_sensor] * 3, scan)).all()
