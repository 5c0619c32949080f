# SPDX-License-Identifier: Apache-2.0
"""Likelihoods of scans from many poses against one beam at a time, and what they are for."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

import oddsmap
from oddsmap import ConfigError, InputError, MapTooLargeError, Pose2, Pose3, State
from oddsmap.array_types import FloatArray
from oddsmap.kernels.query.pose_likelihoods import BeamMixture, beam_log_likelihoods
from oddsmap.query import likelihood_field as fields
from oddsmap.simulate import Lidar2D, office_drive, office_plan
from tests.naive import localisation as naive

RESOLUTION, RANGE_MAX = 0.25, 8.0
ORIGIN = Pose2(0.0, 0.0, 0.0)
FIELD = {"sigma_hit": 0.3, "z_hit": 0.9, "z_rand": 0.2, "max_distance": 1.1}
BEAM = {
    "sigma_hit": 0.4, "lambda_short": 0.3, "z_hit": 0.6, "z_short": 0.2, "z_max": 0.15,
    "z_rand": 0.05,
}  # fmt: skip


@cache
def view_of(ndim: int) -> Any:
    """Some occupied cells among free ones."""
    rng = np.random.default_rng(ndim)
    grid = oddsmap.EvidenceMap(RESOLUTION, ndim=ndim)
    cells = np.unique(rng.integers(-12, 12, (250 if ndim == 2 else 2500, ndim)), axis=0)
    occupied = rng.random(len(cells)) < 0.15
    vote = np.int64(5 << 16)
    grid.add_cells(cells, np.where(occupied, vote, 0), np.where(occupied, 0, vote))
    return grid.log_odds()


def states_of(view: Any) -> dict[tuple[int, ...], int]:
    index, p = view.cells()
    state = view.thresholds.state(p, np.ones(len(p), np.bool_))
    return dict(zip(map(tuple, index.tolist()), state.tolist(), strict=True))


def rotation(rng: np.random.Generator, ndim: int) -> FloatArray:
    turn, _ = np.linalg.qr(rng.normal(size=(ndim, ndim)))
    return turn * np.sign(np.linalg.det(turn)) if ndim == 3 else turn


def poses_of(ndim: int, count: int) -> tuple[FloatArray, list[naive.Pose]]:
    """As they are given, and as rotations and positions."""
    rng = np.random.default_rng(10 + ndim)
    places = rng.uniform(-4.0, 4.0, (count, ndim))
    if ndim == 2:
        yaw = rng.uniform(-4.0, 4.0, count)
        turns = [Pose2(0.0, 0.0, angle).rotation for angle in yaw.tolist()]
        given = np.column_stack([places, yaw])
    else:
        turns = [rotation(rng, 3) for _ in range(count)]
        given = np.tile(np.eye(4), (count, 1, 1))
        given[:, :3, :3], given[:, :3, 3] = turns, places
    return given, [(r.tolist(), t) for r, t in zip(turns, places.tolist(), strict=True)]


def scan_of(ndim: int) -> oddsmap.Scan:
    """Readings of all kinds."""
    rng = np.random.default_rng(20 + ndim)
    ways = rng.normal(size=(24, ndim))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    ranges = rng.uniform(0.0, 6.0, 24)
    ranges[:6] = [math.inf, RANGE_MAX, RANGE_MAX + 1.0, math.nan, -math.inf, 0.0]
    pose: Any = (0.0, 0.0, 0.0) if ndim == 2 else np.eye(4)
    return oddsmap.Scan(pose, ways, ranges)


def beams_of(scan: oddsmap.Scan) -> list[tuple[list[float], float]]:
    return list(zip(scan.directions.tolist(), scan.ranges.tolist(), strict=True))


@pytest.mark.parametrize("ndim", [2, 3])
def test_the_likelihood_field_is_that_of_single_beams(ndim: int) -> None:
    view, scan = view_of(ndim), scan_of(ndim)
    given, poses = poses_of(ndim, 40)
    occupied = [cell for cell, state in states_of(view).items() if state == State.OCCUPIED]
    found = view.likelihood_field(RANGE_MAX, **FIELD).log_likelihood(given, scan)
    for pose, got in zip(poses, found.tolist(), strict=True):
        want = naive.likelihood_field(
            occupied, RESOLUTION, pose, beams_of(scan), range_max=RANGE_MAX, **FIELD
        )
        assert got == pytest.approx(want, rel=1e-12)


@pytest.mark.parametrize("max_distance", [63.75, 63.9, 64.0, 90.0])
def test_a_field_of_long_distances(max_distance: float) -> None:
    """Squared distances in cells of up to 2 bytes, and of more."""
    view, scan = view_of(2), scan_of(2)
    given, _ = poses_of(2, 40)
    given[:, :2] *= 20.0
    options = {**FIELD, "sigma_hit": 20.0, "max_distance": max_distance}
    field = view.likelihood_field(RANGE_MAX, **options)
    occupied = [cell for cell, state in states_of(view).items() if state == State.OCCUPIED]
    found = field.log_likelihood(given, scan)
    for (x, y, yaw), got in zip(given.tolist(), found.tolist(), strict=True):
        pose = Pose2(x, y, yaw).rotation.tolist(), [x, y]
        want = naive.likelihood_field(
            occupied, RESOLUTION, pose, beams_of(scan), range_max=RANGE_MAX, **options
        )
        assert got == pytest.approx(want, rel=1e-12)
    assert len(set(found.tolist())) > 20


def test_a_field_keeps_two_bytes_a_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    view = view_of(3)
    index = np.array([c for c, state in states_of(view).items() if state == State.OCCUPIED])
    cells = np.prod(np.ptp(index, axis=0) + 1 + 2 * 8)  # 2 m are 8 cells
    assert view.likelihood_field(RANGE_MAX).nbytes == 2 * cells + 8 * (8 * 8 + 2)
    monkeypatch.setattr(fields, "memory_limit", lambda: 9 * int(cells))
    with pytest.raises(MapTooLargeError, match=r"of 40 x 40 x 40 cells takes .* max_distance"):
        view.likelihood_field(RANGE_MAX)


@pytest.mark.parametrize("ndim", [2, 3])
def test_the_beam_model_is_that_of_single_beams(ndim: int) -> None:
    view, scan = view_of(ndim), scan_of(ndim)
    given, poses = poses_of(ndim, 12)
    found = view.beam_likelihood(RANGE_MAX, **BEAM).log_likelihood(given, scan)
    states = states_of(view)
    for pose, got in zip(poses, found.tolist(), strict=True):
        want = naive.beam_model(
            states, int(State.OCCUPIED), RESOLUTION, pose, beams_of(scan), range_max=RANGE_MAX,
            **BEAM,
        )  # fmt: skip
        assert got == pytest.approx(want, rel=1e-9)


@pytest.mark.parametrize("there", [0.0, 0.01, 0.5, 4.0, 7.9, 8.0, 30.0])
def test_the_beam_model_is_a_distribution(there: float) -> None:
    """Its density up to range_max and the mass at it add up to 1."""
    model = BeamMixture(0.6, 0.2, 0.15, 0.05, 0.05, 0.3, RANGE_MAX)

    def p(z: float) -> float:
        out = np.empty(1)
        beam_log_likelihoods(np.array([z]), np.array([there / RESOLUTION]), RESOLUTION, model, out)
        return math.exp(out[0])

    kinks = [x for x in (there - 0.2, there, there + 0.2) if 0.0 < x < RANGE_MAX]
    mass, _ = quad(p, 0.0, RANGE_MAX - 1e-12, points=kinks or None, limit=500)
    # Nothing can be shorter than 0.
    want = 1.0 - BEAM["z_max"] - (0.2 if there == 0.0 else 0.0)
    assert mass == pytest.approx(want, abs=1e-6)


def asked(view: Any) -> list[Any]:
    return [view.likelihood_field(RANGE_MAX), view.beam_likelihood(RANGE_MAX)]


@pytest.mark.parametrize("ndim", [2, 3])
def test_batches_threads_and_parts_of_the_poses_change_nothing(ndim: int) -> None:
    given, _ = poses_of(ndim, 6000)
    for model in asked(view_of(ndim)):
        whole = model.log_likelihood(given, scan_of(ndim))
        assert np.array_equal(whole, model.log_likelihood(given, scan_of(ndim), threads=2))
        assert np.array_equal(whole[5990:], model.log_likelihood(given[5990:], scan_of(ndim)))
        assert model.log_likelihood(given[:0], scan_of(ndim)).shape == (0,)
        assert model.nbytes > 0


def test_poses_as_objects_and_beams_of_their_own_origins() -> None:
    plane, plane_poses = poses_of(2, 5)
    space, _ = poses_of(3, 5)
    for model in asked(view_of(2)):
        objects = [Pose2(*row) for row in plane.tolist()]
        assert np.array_equal(
            model.log_likelihood(objects, scan_of(2)), model.log_likelihood(plane, scan_of(2))
        )
    for model in asked(view_of(3)):
        rigid = [Pose3(row[:3, :3], row[:3, 3]) for row in space]
        assert np.array_equal(
            model.log_likelihood(rigid, scan_of(3)), model.log_likelihood(space, scan_of(3))
        )
    # A sensor that sits 0.5 m ahead of what poses are of is a scan whose beams start there.
    scan = scan_of(2)
    ahead = np.tile([0.5, 0.0], (scan.size, 1))
    mounted = oddsmap.Scan(ORIGIN, scan.directions, scan.ranges, beam_origins=ahead)
    moved = plane.copy()
    for i, (turn, _) in enumerate(plane_poses):
        moved[i, :2] += 0.5 * np.array(turn)[:, 0]
    for model in asked(view_of(2)):
        assert model.log_likelihood(plane, mounted) == pytest.approx(
            model.log_likelihood(moved, scan), rel=1e-9
        )


def test_some_of_the_beams() -> None:
    scan, poses = scan_of(2), poses_of(2, 3)[0]
    chosen = np.rint(np.linspace(0, 23, 7)).astype(int)
    fewer = oddsmap.Scan(ORIGIN, scan.directions[chosen], scan.ranges[chosen])
    for model in asked(view_of(2)):
        assert np.array_equal(
            model.log_likelihood(poses, scan, max_beams=7), model.log_likelihood(poses, fewer)
        )
        assert np.array_equal(
            model.log_likelihood(poses, scan, max_beams=99), model.log_likelihood(poses, scan)
        )


def test_a_turned_map_gives_turned_answers() -> None:
    plane = view_of(2).to_probability_map()
    yaw, shift = 0.7, np.array([30.0, -5.0])
    turn = Pose2(0.0, 0.0, yaw).rotation
    corner = turn @ np.array(plane.origin) + shift
    askew = oddsmap.ProbabilityMap(
        plane.probability, plane.observed, RESOLUTION, (corner[0], corner[1]), yaw
    )
    given, _ = poses_of(2, 200)
    turned = np.column_stack([given[:, :2] @ turn.T + shift, given[:, 2] + yaw])
    for straight, other in zip(asked(plane), asked(askew), strict=True):
        one = straight.log_likelihood(given, scan_of(2))
        # An end on the border of two cells may fall into the other one by rounding.
        same = np.isclose(one, other.log_likelihood(turned, scan_of(2)), rtol=1e-9)
        assert np.count_nonzero(same) >= 195


def test_maps_without_obstacles() -> None:
    grid = oddsmap.EvidenceMap(RESOLUTION)
    given, scan = poses_of(2, 3)[0], scan_of(2)
    field, beam = asked(grid.log_odds())
    far = math.log(0.95 * math.exp(-0.5 * (2.0 / 0.2) ** 2) + 0.05 / RANGE_MAX)
    returned = np.count_nonzero((scan.ranges >= 0.0) & (scan.ranges < RANGE_MAX))
    assert field.log_likelihood(given, scan) == pytest.approx(np.full(3, far * returned))
    assert np.ptp(beam.log_likelihood(given, scan)) == 0.0
    silent = oddsmap.Scan(ORIGIN, np.array([[1.0, 0.0]]), np.array([math.nan]))
    for model in (field, beam):
        assert model.log_likelihood(given, silent).tolist() == [0.0] * 3


def test_the_true_pose_is_the_best_of_many() -> None:
    plan, lidar, rng = office_plan(), Lidar2D(), np.random.default_rng(0)
    scans = [lidar.scan(plan, pose, rng) for pose in office_drive(120)]
    view = oddsmap.build_map(scans, 0.1).log_odds()
    for scan in scans[10::30]:
        pose = scan.map_from_sensor
        assert isinstance(pose, Pose2)
        true = np.array([pose.x, pose.y, pose.theta])
        others = true + rng.normal(size=(2000, 3)) * (1.0, 1.0, 0.5)
        apart = np.hypot(*(others - true)[:, :2].T) + np.abs(others - true)[:, 2]
        given = np.vstack([true, others[apart > 0.3]])
        for model in (view.likelihood_field(20.0), view.beam_likelihood(20.0)):
            assert np.argmax(model.log_likelihood(given, scan, max_beams=60)) == 0


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"poses": [0.0, 0.0, 0.0]}, InputError, r"got \(3,\) \(one alone is \[pose\]\)"),
        ({"poses": [[0.0, 0.0]]}, InputError, r"\(x, y, yaw\) each, shape \(n, 3\)"),
        ({"poses": [[0.0, 0.0, math.nan]]}, InputError, "1 of 1 poses are not finite"),
        ({"poses": [[1e15, 0.0, 0.0]]}, InputError, "no cell"),
        ({"poses": [["a", 0.0, 0.0]]}, InputError, "poses are numbers"),
        ({"poses": [Pose2(0, 0, 0), Pose3(np.eye(3), np.zeros(3))]}, InputError, "all Pose2"),
        ({"scan": scan_of(3)}, InputError, "the scan is 3D, the map 2D"),
        ({"scan": [1.0, 2.0]}, InputError, "needs a Scan, got list"),
        ({"max_beams": 0}, ConfigError, "max_beams is at least 1"),
        ({"threads": 0}, ConfigError, "threads are at least 1"),
    ],
)
def test_what_is_refused(change: dict[str, Any], error: Any, message: str) -> None:
    call = {"poses": [[0.0, 0.0, 0.0]], "scan": scan_of(2), **change}
    for model in asked(view_of(2)):
        with pytest.raises(error, match=message):
            model.log_likelihood(**call)


def test_matrices_that_are_no_poses() -> None:
    for model in asked(view_of(3)):
        for matrix in (2.0 * np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0])):
            with pytest.raises(InputError, match="1 of 1 poses are no rotation"):
                model.log_likelihood([matrix], scan_of(3))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"range_max": 0.0}, "range_max"),
        ({"range_max": math.inf}, "range_max"),
        ({"sigma_hit": 0.0}, "sigma_hit"),
        ({"max_distance": math.nan}, "max_distance is a length"),
        ({"max_distance": 3e8}, r"max_distance is less than 2\^30 cells, 2.68435e\+08 m here"),
        ({"z_hit": 0.0}, "z_hit is a weight above 0"),
        ({"z_rand": -1.0}, "z_rand one of 0 or more"),
    ],
)
def test_fields_that_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        view_of(2).likelihood_field(**{"range_max": 8.0, **options})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"range_max": math.nan}, "range_max lies above 0"),
        ({"sigma_hit": -1.0}, "sigma_hit"),
        ({"lambda_short": 0.0}, "lambda_short"),
        ({"z_hit": 0.9}, "add up to 1, got z_hit 0.9, z_short 0.1"),
        ({"z_hit": 1.0, "z_short": -0.1}, "0 or more"),
        ({"z_hit": math.nan}, "add up to 1"),
    ],
)
def test_beam_models_that_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        view_of(2).beam_likelihood(**{"range_max": 8.0, **options})
