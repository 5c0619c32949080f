# SPDX-License-Identifier: Apache-2.0
"""Batch estimation of the whole map: what must not matter, what must, and what is refused."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.forward import beam_rows as rows
from oddsmap.forward import cell_grid as field
from oddsmap.forward.beams import Beams
from oddsmap.full_map.estimator import FullMapEstimator, build_full_map
from oddsmap.full_map.full_map import FullMap, load_full_map
from oddsmap.odds import State
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.overhead import OverheadSensor
from oddsmap.sensors.registry import Sensor
from oddsmap.sensors.usable_beams import usable_beams
from tests.full_map.kit import (
    RESOLUTION,
    SONAR,
    TOF,
    beam,
    estimated,
    moved,
    room,
    same,
    wall_of_space,
)

ROOM = ((0, 0), (60, 40))


@pytest.fixture(scope="module")
def furnished() -> FullMap:
    """The room of the kit, well observed."""
    return estimated(room(200))


def difference(one: FullMap, other: FullMap, shift: tuple[int, int] = (0, 0)) -> float:
    """Mean difference of probability over the cells of the room that both observed."""
    box = (np.add(ROOM[0], shift), np.add(ROOM[1], shift))
    both = one.observed(ROOM) & other.observed(box)
    assert np.count_nonzero(both) > 2000
    return float(np.abs(one.probability(ROOM) - other.probability(box))[both].mean())


# ---- what a map looks like -------------------------------------------------------------------


def test_a_room(furnished: FullMap) -> None:
    truth = np.ones((40, 60), np.bool_)
    truth[1:-1, 1:-1] = False
    truth[25:30, 20:30] = True
    p, seen = furnished.probability(ROOM), furnished.observed(ROOM)
    assert np.count_nonzero(seen & ~truth) > 2000
    assert (p[seen & ~truth] < 0.5).mean() > 0.995
    faces = seen[0, 5:55]  # of the wall behind y = 0
    assert faces.mean() > 0.9
    assert (p[0, 5:55][faces] > 0.5).mean() > 0.9
    assert furnished.converged
    assert furnished.sweeps < 20
    # Nobody has been inside of the box.
    assert not seen[27, 22:28].any()
    assert (furnished.state(ROOM)[27, 22:28] == State.UNKNOWN).all()


def test_few_beams_are_not_taken_for_rest() -> None:
    """Before unseen cells are thought free no long cone says anything: that is not convergence."""
    residuals: list[float] = []
    build_full_map(
        room(60), RESOLUTION, sensor=SONAR, progress=lambda _, residual: residuals.append(residual)
    )
    assert len(residuals) > 5
    assert max(residuals) > 0.1
    assert residuals[-1] < 2e-3


def test_a_wall_of_space() -> None:
    grid = estimated(wall_of_space(2.0, 200))
    assert grid.ndim == 3
    box = ((2, -3, -3), (25, 4, 4))
    p, seen = grid.probability(box), grid.observed(box)
    depth = np.arange(2, 25)
    before, wall, behind = depth < 19, depth == 20, depth > 21
    assert seen[:, :, before].mean() > 0.99
    assert (p[:, :, before] < 0.1).all()
    # Hundreds of beams have met it: each cell or one beside it, never a hole.
    assert p[:, :, wall].mean() > 0.5
    assert not seen[:, :, behind].any()
    index, _ = grid.cells()
    assert index[:, 0].max() <= 21


def test_narrow_beams() -> None:
    scans = [beam(0.05, 0.05 + 0.01 * i, 0.0, 1.0) for i in range(9)]
    grid = build_full_map(scans, RESOLUTION, sensor=BeamSensor(range_max=3.0))
    p = grid.probability(((0, 0), (12, 1)))[0]
    assert (p[1:9] < 0.2).all()
    assert p[10] > 0.9
    assert not grid.observed(((12, 0), (20, 1))).any()


# ---- what must not matter --------------------------------------------------------------------


@pytest.mark.parametrize("schedule", ["chunks", "sequential", "parallel"])
@pytest.mark.parametrize("space", [False, True])
def test_threads_change_no_bit(schedule: str, space: bool) -> None:
    scans = wall_of_space(2.0, 10) if space else room(20)
    one, two, three, many = (
        estimated(scans, threads=threads, schedule=schedule, sweeps=4) for threads in (1, 2, 3, 7)
    )
    assert same(one, two)
    assert same(one, three)
    assert same(one, many)


def test_a_seed_gives_the_same_map_again_and_another_one_another_order() -> None:
    first, again, other = (estimated(room(20), seed=seed, sweeps=4) for seed in (3, 3, 4))
    assert same(first, again)
    assert not same(first, other)


def test_neither_order_nor_schedule_nor_seed_says_much(furnished: FullMap) -> None:
    scans = room(200)
    shuffled = [scans[i] for i in np.random.default_rng(0).permutation(len(scans))]
    assert difference(furnished, estimated(shuffled)) < 1e-3
    assert difference(furnished, estimated(scans, seed=1)) < 1e-3
    assert difference(furnished, estimated(scans, schedule="sequential")) < 1e-3
    assert difference(furnished, estimated(scans, schedule="parallel", sweeps=60)) < 2e-3


@pytest.mark.parametrize("cells", [(5_000_000, 54_000_000), (-704, -320), (-37, 11)])
def test_where_the_origin_is_says_little(furnished: FullMap, cells: tuple[int, int]) -> None:
    """Also hundreds of kilometres away (UTM), and below 0."""
    by = (cells[0] * RESOLUTION, cells[1] * RESOLUTION)
    assert difference(furnished, estimated(moved(room(200), by)), cells) < 2e-3


def test_two_logs_are_one() -> None:
    scans = room(20)
    estimator = FullMapEstimator(Config(map=MapConfig(resolution=RESOLUTION), sensor=SONAR))
    estimator.add_log(scans[:7])
    estimator.add_log(scan for scan in scans[7:])  # once only
    grid = estimator.estimate()
    assert same(grid, estimated(scans))
    assert [entry["scans"] for entry in grid.provenance] == [7, 13]
    # Asking again neither adds nor counts anything again.
    again = estimator.estimate()
    assert same(grid, again)
    assert again.report is not None
    assert (again.report.scans, again.report.beams) == (20, 240)


# ---- what must matter ------------------------------------------------------------------------


def test_a_scan_twice_is_two_readings() -> None:
    scan = [beam(0.05, 0.05, 0.0, 0.5)]
    once, twice, thrice = (estimated(scan * n, prior=0.2, coupling=0.0) for n in (1, 2, 3))
    cells = once.known_log_odds()[0]
    prior = math.log(0.2 / 0.8)
    away = [
        np.abs(grid.log_odds(((-2, -9), (9, 9)))[cells[:, 1] + 9, cells[:, 0] + 2] - prior)
        for grid in (once, twice, thrice)
    ]
    free = cells[:, 0] < 4
    assert np.count_nonzero(free) == 3
    for less, more in itertools.pairwise(away):
        assert (more[free] > less[free] + 0.05).all()


def test_more_sweeps_are_not_more_evidence() -> None:
    """With one beam the first sweep is exact, and hundreds of them change no bit of it."""
    scan = [beam(0.05, 0.05, 0.0, 0.5)]
    one, many = (estimated(scan, coupling=0.0, sweeps=n, tolerance=0.0) for n in (1, 300))
    assert (one.sweeps, many.sweeps) == (1, 300)
    assert same(one, many)


def test_at_rest_more_sweeps_change_little(furnished: FullMap) -> None:
    longer = estimated(room(200), sweeps=80, tolerance=0.0)
    assert longer.sweeps == 80
    assert difference(furnished, longer) < 2e-3
    sure = [np.abs(grid.known_log_odds()[1]).mean() for grid in (furnished, longer)]
    assert sure[1] == pytest.approx(sure[0], rel=0.02)


def test_unknown_is_what_no_beam_reached() -> None:
    """One random reading from behind a wall has seen nothing there, whatever it lists."""
    wall = [beam(0.05, 0.05, 0.0, 1.0)] * 20
    grid = estimated([*wall, beam(0.05, 0.05, 0.0, 2.2)])
    behind = ((13, -3), (20, 4))
    assert grid.marks_of(behind).any()
    assert not grid.observed(behind).any()
    assert (grid.state(behind) == State.UNKNOWN).all()
    before = ((2, 0), (9, 1))
    assert grid.observed(before).all()
    index, _ = grid.cells()
    assert index[:, 0].max() <= 11
    assert grid.cell_count == len(index)
    # Without the wall the same reading has seen the same cells.
    assert estimated([beam(0.05, 0.05, 0.0, 2.2)] * 3).observed(((13, 0), (20, 1))).all()
    # The prior's word on cells that nobody saw makes none of them known.
    assert not grid.observed(((-12, -12), (0, -5))).any()


def test_cells_of_the_npz(tmp_path: Any) -> None:
    wall = [beam(0.05, 0.05, 0.0, 1.0)] * 20
    grid = estimated([*wall, beam(0.05, 0.05, 0.0, 2.2)])
    grid.save_npz(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        index, observed, p = arrays["index"], arrays["observed"], arrays["probability"]
        assert not arrays["hits"].any()
        assert not arrays["passes"].any()
        assert arrays["resolution"] == RESOLUTION
    known, believed = grid.cells()
    np.testing.assert_array_equal(index[observed], known)
    np.testing.assert_allclose(p[observed], believed, rtol=1e-6)
    hidden = index[~observed]
    assert len(hidden) > 50
    assert hidden[:, 0].max() >= 20
    assert (grid.marks_of((hidden.min(axis=0), hidden.max(axis=0) + 1)) > 0).any()


# ---- which readings count --------------------------------------------------------------------


def test_readings_are_sorted_and_counted() -> None:
    ways = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [0.6, 0.8], [-0.6, -0.8]])
    ranges = np.array([1.0, np.inf, np.nan, 0.1, 3.0, 1.2])
    lost = Scan(Pose2(math.nan, 0.0, 0.0), ways, ranges)
    empty = Scan(Pose2(1.0, 1.0, 0.0), ways[:1], np.array([-np.inf]))
    scans = [Scan(Pose2(0.05, 0.05, 0.0), ways, ranges), lost, empty]
    sensor = ConeSensor(cone_deg=20.0, range_min=0.2, range_max=3.0)
    grid = build_full_map(scans, RESOLUTION, sensor=sensor)
    assert grid.report is not None
    assert (grid.report.scans, grid.report.beams) == (1, 4)
    assert grid.report.skipped == {
        "scan.nan_pose": 1, "scan.empty": 1, "beam.nan": 1, "beam.below_range_min": 2,
    }  # fmt: skip
    # A cone's finite reading at range_max is a no-return, with a clear_range or without.
    clearing = ConeSensor(cone_deg=20.0, range_min=0.2, range_max=3.0, clear_range=3.0)
    told = build_full_map(scans, RESOLUTION, sensor=clearing)
    assert np.array_equal(told.log_odds(), grid.log_odds())


def test_directions_that_are_no_numbers_are_counted() -> None:
    axes = np.array([[1.0, 0.0], [np.nan, 0.0], [np.inf, 0.0]])
    scan = Scan(Pose2(0.0, 0.0, 0.0), axes, np.ones(3))
    report = build_full_map([scan], RESOLUTION, sensor=SONAR).report
    assert report is not None
    assert (report.beams, report.skipped) == (1, {"beam.nan": 2})


def test_a_rotation_of_few_digits_is_one() -> None:
    c, s = 0.9553, 0.2955  # of 0.3 rad, which makes vectors of length 0.99995
    pose = Pose3.from_matrix(np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0]]))
    beams, _ = Beams.from_scans([Scan(pose, np.eye(3), np.ones(3))])
    assert np.abs(np.linalg.norm(beams.directions, axis=1) - 1.0).max() < 1e-12
    assert beams.directions[0] == pytest.approx([c, s, 0.0], abs=1e-4)
    with pytest.raises(InputError, match="a unit vector"):
        Beams.from_scans([Scan(pose, 1.01 * np.eye(3), np.ones(3), trusted=True)])


@pytest.mark.parametrize("box", [((5, 5), (0, 0)), ((0, 0, 0), (1, 1, 1))])
def test_regions_that_will_not_do(furnished: FullMap, box: Any) -> None:
    with pytest.raises(InputError, match="a region needs lo <= hi of 2 indices"):
        furnished.log_odds(box)


def test_beams_that_end_at_the_sensor_are_an_empty_map() -> None:
    grid = build_full_map([beam(0.5, 0.5, 0.0, 0.02)], 1.0, sensor=SONAR)
    assert grid.cell_count == 0
    assert grid.bounds() is None
    assert grid.log_odds().shape == (0, 0)


# ---- what is refused -------------------------------------------------------------------------


def refused(call: Callable[[], object], error: type[Exception]) -> str:
    with pytest.raises(error) as caught:
        call()
    text = str(caught.value)
    assert "\n" not in text
    return text


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (ConeSensor(cone_deg=25.0, range_max=3.0, p_random=0.0), "p_random lies above 0, got 0"),
        (BeamSensor(range_max=3.0, p_random=0.0), "p_random lies above 0, got 0"),
        (ConeSensor(cone_deg=25.0), "range_max is needed by the forward model"),
        (BeamSensor(), "range_max is needed by the forward model"),
        (OverheadSensor(), "for beams and cones; a sensor of kind overhead"),
        (ConeSensor(cone_deg=25.0, range_max=3.0, mark_z_min=0.1), "sensor.mark_z_min is for the"),
        (
            BeamSensor(range_max=3.0, body_min=(0.0, 0.0, 0.0), body_max=(1.0, 1.0, 1.0)),
            "sensor.body_min is for the filter",
        ),
    ],
)
def test_sensors_that_will_not_do(sensor: Sensor, message: str) -> None:
    scans = [beam(0.0, 0.0, 0.0, 1.0)]
    assert message in refused(lambda: build_full_map(scans, 0.1, sensor=sensor), ConfigError)


def test_settings_that_will_not_do() -> None:
    for prior in (0.0, 1.0, -0.1, math.nan):
        said = refused(lambda p=prior: FullMapConfig(prior=p), ConfigError)  # type: ignore[misc]
        assert "prior lies between 0 and 1" in said
    said = refused(lambda: ConeSensor(cone_deg=180.5, range_max=3.0), ConfigError)
    assert "up to 180 degrees, got 180.5" in said
    said = refused(lambda: estimated([beam(0.0, 0.0, 0.0, 1.0)], threads=0), ConfigError)
    assert "threads: at least 1" in said
    fading = MapConfig(resolution=0.1, votes="beam", half_life=5.0)
    said = refused(lambda: FullMapEstimator(Config(map=fading, sensor=SONAR)), ConfigError)
    assert "map.half_life is for the filter" in said


@pytest.mark.parametrize(
    ("scans", "message"),
    [
        ([], "no usable scan (there are none)"),
        ([beam(math.nan, 0.0, 0.0, 1.0)], "no usable scan (1 x scan.nan_pose)"),
        ([beam(0.0, 0.0, 0.0, math.nan)], "1 x beam.nan"),
        (
            [beam(0, 0, 0, 1.0), Scan(Pose3(np.zeros(3), np.eye(3)), np.eye(3)[:1], np.ones(1))],
            "all 2D or all 3D",
        ),
    ],
)
def test_scans_that_will_not_do(scans: list[Scan], message: str) -> None:
    assert message in refused(lambda: build_full_map(scans, 0.1, sensor=SONAR), InputError)


def test_poses_out_of_this_world() -> None:
    """From 2^45 cells on they are skipped, as by the filter; nearer ones are mapped there."""
    said = refused(lambda: estimated([beam(1e30, 0.0, 0.0, 1.0)]), InputError)
    assert "no usable scan (1 x scan.pose_too_far)" in said
    scans = room(10)
    here = estimated(scans, schedule="sequential")
    with_one = estimated(
        [*scans[:4], beam(0.0, -1e30, 0.0, 1.0), *scans[4:]], schedule="sequential"
    )
    assert same(here, with_one)
    assert with_one.report is not None
    assert with_one.report.skipped == {"scan.pose_too_far": 1}
    assert (with_one.report.scans, with_one.report.beams) == (10, 120)
    limit = 2.0**45 * RESOLUTION
    for x, skipped in ((limit, 1), (-limit, 1), (0.9 * limit, 0)):
        report = estimated([*scans[:1], beam(x, 0.0, 0.0, 1.0)], sweeps=1).report
        assert report is not None
        assert (report.skipped["scan.pose_too_far"], report.scans) == (skipped, 2 - skipped)


@pytest.mark.parametrize("space", [False, True])
def test_an_island_changes_nothing_here(space: bool, tmp_path: Any) -> None:
    """One scan 10^9 m away, in the middle of a log: beams that share no cell do not meet."""
    scans = wall_of_space(2.0, 8) if space else room(8)
    d = 3 if space else 2
    pose = Pose3(np.full(3, 1e9 + 0.05), np.eye(3)) if space else Pose2(1e9, -1e9, 0.0)
    island = Scan(pose, np.eye(d)[:1], np.array([1.0]))
    here = estimated(scans, schedule="parallel", sweeps=5, tolerance=0.0)
    both = estimated([*scans[:4], island, *scans[4:]], schedule="parallel", sweeps=5, tolerance=0.0)
    assert both.report is not None
    assert (both.report.scans, +both.report.skipped) == (9, {})
    box = here.bounds()
    assert box is not None
    np.testing.assert_array_equal(both.log_odds(box), here.log_odds(box))
    np.testing.assert_array_equal(both.marks_of(box), here.marks_of(box))
    alone = estimated([island], schedule="parallel", sweeps=5, tolerance=0.0)
    there = alone.bounds()
    assert there is not None
    np.testing.assert_array_equal(both.log_odds(there), alone.log_odds(there))
    assert both.observed(there).any()
    both.save(tmp_path / "a.zarr")
    again = load_full_map(tmp_path / "a.zarr")
    np.testing.assert_array_equal(again.log_odds(there), alone.log_odds(there))
    assert again.cell_count == both.cell_count


@pytest.mark.parametrize("space", [False, True])
def test_many_small_windows_list_what_one_lists(
    monkeypatch: pytest.MonkeyPatch, space: bool
) -> None:
    scans = wall_of_space(2.0, 8) if space else room(8)
    sensor = TOF if space else SONAR
    beams, _, _ = usable_beams(scans, sensor, RESOLUTION)

    def listed() -> tuple[int, Any, Any]:
        grid = field.CellField(beams.ndim, 0)
        count = len(list(field.windows_of(grid, beams.origins / RESOLUTION, 45.0)))
        found = rows.list_rows(grid, beams, sensor.forward_model(), RESOLUTION)
        return count, found, grid.index(found.cells)

    one, whole, cells = listed()
    first = estimated(scans, sweeps=3)
    grid = field.CellField(beams.ndim, 0)
    poses = np.unique(beams.origins / RESOLUTION, axis=0)
    alone = [next(field.windows_of(grid, pose[None], 45.0))[1].shape for pose in poses]
    largest = max(int(np.prod(shape // grid.side)) for shape in alone)
    monkeypatch.setattr(field, "_MAX_BLOCKS", largest)
    many, parts, again = listed()
    assert one == 1 < many <= len(poses)
    np.testing.assert_array_equal(again, cells)
    for name in ("readings", "offsets", "bins", "fractions"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    assert same(first, estimated(scans, sweeps=3))


def test_one_beam_too_long_for_a_window() -> None:
    sensor = ConeSensor(cone_deg=5.0, range_max=1500.0)
    lone = Scan(Pose3(np.zeros(3), np.eye(3)), np.eye(3)[:1], np.array([np.inf]))
    said = refused(lambda: build_full_map([lone] * 2, 0.1, sensor=sensor), MapTooLargeError)
    assert "the beams span" in said


def test_memory_that_would_not_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "memory_limit", lambda: 100_000)
    said = refused(lambda: estimated(room(20)), MapTooLargeError)
    assert "full-map estimation of 240 beams" in said
    assert "GB of memory (there are 0.0001 GB): use a coarser resolution, a lower range_max" in said
    monkeypatch.setattr(rows, "memory_limit", lambda: 100_000_000)
    estimated(room(20), sweeps=1)


def test_a_resolution_far_too_fine() -> None:
    said = refused(
        lambda: build_full_map([beam(0.0, 0.0, 0.0, 1.0)], 1e-5, sensor=SONAR), MapTooLargeError
    )
    assert "range bins: use a coarser resolution" in said


def test_not_at_rest_is_reported_and_usable() -> None:
    grid = estimated(room(60), sweeps=1)
    assert not grid.converged
    assert grid.sweeps == 1
    assert grid.residual > 1e-3
    assert np.isfinite(grid.log_odds()).all()
