# SPDX-License-Identifier: Apache-2.0
"""Scans taken on the move, one by one."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from oddsmap import BeamSensor, build_full_map, build_map
from oddsmap.array_types import IntArray
from oddsmap.poses.at_times import PoseArray, PoseTrack
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.poses.trajectory import NoPoseError, Trajectory
from oddsmap.scans.deskew import deskew
from oddsmap.scans.scan import Scan
from tests.kit import ONE, votes_of

MS = 10**6
STEPS = 11
STAMP = 500 * MS


def poses_of_a_turn(*, flat: bool, speed: float = 3.0) -> Trajectory:
    """One second of driving and turning, in the plane or in space."""
    places, turns = [], []
    for k in range(STEPS):
        t = k / (STEPS - 1)
        axis = np.array([0.0, 0.0, 1.0]) if flat else np.array([0.3, -0.2, 0.9])
        axis /= np.linalg.norm(axis)
        q = [*(axis * math.sin(0.75 * t)), math.cos(0.75 * t)]
        pose = Pose3.from_quaternion_xyzw((speed * t, 0.4 * t, 0.0 if flat else 0.3 * t), q)
        places.append(pose.translation)
        turns.append(pose.rotation)
    return Trajectory(np.array(places), np.array(turns), np.arange(STEPS) * (1000 // 10) * MS)


def asked(poses: Trajectory) -> Callable[[IntArray], PoseArray]:
    track = PoseTrack(poses)
    return lambda times: track.at(times, 100 * MS)


def from_above(pose: Pose3) -> Pose2:
    x, y, _ = pose.translation.tolist()
    return Pose2(x, y, math.atan2(pose.rotation[1, 0], pose.rotation[0, 0]))


def taken(poses: Trajectory, ndim: int, seed: int, *, as_points: bool = False) -> Scan:
    """Beams in any order of times, some of them at once, within 0.4 s around the stamp."""
    rng = np.random.default_rng(seed)
    count = 60
    ways = rng.normal(size=(count, ndim))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    ranges = rng.uniform(0.3, 6.0, count)
    at = poses.at(STAMP, 100 * MS)
    if as_points:
        scan = Scan.from_points(at, ways * ranges[:, None], STAMP)
    else:
        pose: Pose2 | Pose3 = from_above(at) if ndim == 2 else at
        scan = Scan(pose, ways, ranges, STAMP, sensor_id="front")
    times = STAMP + rng.integers(-20, 20, count) * 10 * MS
    object.__setattr__(scan, "beam_times_ns", times)
    return scan


def beam_by_beam(scan: Scan, poses: Trajectory) -> list[Scan]:
    """The slow way: for each beam the pose at its time, and a scan of its own."""
    assert scan.beam_times_ns is not None
    alone = []
    for i, time in enumerate(scan.beam_times_ns.tolist()):
        pose = poses.at(time, 100 * MS)
        if scan.measured_points is not None:
            alone.append(Scan.from_points(pose, scan.measured_points[i : i + 1], time))
            continue
        own: Pose2 | Pose3 = from_above(pose) if scan.directions.shape[1] == 2 else pose
        alone.append(Scan(own, scan.directions[i : i + 1], scan.ranges[i : i + 1], time))
    return alone


def once(counts: dict[Any, tuple[int, int]]) -> dict[Any, tuple[int, int]]:
    return {cell: (min(h, ONE), 0 if h else min(p, ONE)) for cell, (h, p) in counts.items()}


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("ndim", "as_points"), [(2, False), (3, False), (3, True)])
def test_deskewed_beams_equal_the_loop_over_beams(seed: int, ndim: int, as_points: bool) -> None:
    poses = poses_of_a_turn(flat=ndim == 2)
    scan = taken(poses, ndim, seed, as_points=as_points)
    moved, left_out = deskew(scan, poses.at(STAMP, 100 * MS), asked(poses))
    assert left_out == 0
    assert moved.sensor_id == scan.sensor_id
    assert moved.map_from_sensor is scan.map_from_sensor
    assert moved.beam_times_ns is not None
    assert (np.diff(moved.beam_times_ns) >= 0).all()
    counts = votes_of(build_map(beam_by_beam(scan, poses), 0.2, votes="beam"))
    assert votes_of(build_map([moved], 0.2, votes="beam")) == counts
    assert votes_of(build_map([moved], 0.2)) == once(counts)
    assert votes_of(build_map([scan], 0.2)) != once(counts)


@pytest.mark.parametrize("ndim", [2, 3])
def test_full_maps_take_them_as_beams_alone(ndim: int) -> None:
    poses = poses_of_a_turn(flat=ndim == 2)
    scan = taken(poses, ndim, 1)
    moved, _ = deskew(scan, poses.at(STAMP, 100 * MS), asked(poses))
    in_order = sorted(beam_by_beam(scan, poses), key=lambda beam: beam.stamp_ns or 0)
    sensor = BeamSensor(range_max=10.0)
    one, other = (build_full_map(scans, 0.5, sensor=sensor) for scans in ([moved], in_order))
    assert np.array_equal(one.blocks, other.blocks)
    np.testing.assert_allclose(one.values, other.values, atol=1e-9)


def test_poses_written_with_few_digits_put_beams_where_they_say() -> None:
    """Rotations that are off by 1e-4 are no rotations; each beam still has its own pose."""
    poses = poses_of_a_turn(flat=False)
    rough = Trajectory(poses.positions, np.round(poses.rotations, 4), poses.stamps_ns)
    scan = taken(rough, 3, 0)
    assert scan.beam_times_ns is not None
    moved, _ = deskew(scan, rough.at(STAMP, 0), asked(rough))
    assert moved.beam_times_ns is not None
    assert moved.beam_origins is not None
    ends = moved.beam_origins + moved.directions * moved.ranges[:, None]
    found = moved.map_from_sensor.transform(ends)
    order = np.argsort(scan.beam_times_ns, kind="stable")
    for i, beam in enumerate(order.tolist()):
        own = rough.at(int(scan.beam_times_ns[beam]), 100 * MS)
        want = own.transform(scan.directions[beam : beam + 1] * scan.ranges[beam])[0]
        np.testing.assert_allclose(found[i], want, atol=1e-9)


@pytest.mark.parametrize("ndim", [2, 3])
def test_the_robot_and_the_window_of_angles_move_along(ndim: int) -> None:
    """A return on the robot is on it wherever it was; angles are those at the beam's own time."""
    poses = poses_of_a_turn(flat=ndim == 2, speed=8.0)
    at = poses.at(STAMP, 0)
    way = np.zeros((3, ndim))
    way[:, 0] = 1.0
    pose: Pose2 | Pose3 = from_above(at) if ndim == 2 else at
    times = STAMP + np.array([-200, 0, 200]) * MS
    scan = Scan(pose, way, np.array([0.4, 0.4, 3.0]), STAMP, beam_times_ns=times)
    moved, _ = deskew(scan, at, asked(poses))
    body = BeamSensor(body_min=(-0.5,) * ndim, body_max=(0.5,) * ndim)
    report = build_map([moved], 0.1, sensor=body).report
    assert report is not None
    assert report.skipped == {"hit.on_body": 2}
    if ndim == 2:
        window = BeamSensor(angle_min=-0.1, angle_max=0.1, range_max=9.0)
        for build in (build_map, build_full_map):
            report = build([moved], 0.1, sensor=window).report
            assert report is not None
            assert (report.beams, dict(report.skipped)) == (3, {})


def test_beams_at_times_without_a_pose_are_left_out() -> None:
    poses = poses_of_a_turn(flat=False)
    scan = taken(poses, 3, 3)
    late = np.where(np.arange(scan.size) % 3 == 0, 2000 * MS, STAMP + 10 * MS)
    object.__setattr__(scan, "beam_times_ns", late)
    moved, left_out = deskew(scan, poses.at(STAMP, 0), asked(poses))
    assert (moved.size, left_out) == (40, 20)
    object.__setattr__(scan, "beam_times_ns", late + 5000 * MS)
    with pytest.raises(NoPoseError, match=r"no pose at the times of the beams, 5\.51 to 7 s"):
        deskew(scan, poses.at(STAMP, 0), asked(poses))


def test_a_scan_that_needs_none_is_given_back() -> None:
    poses = poses_of_a_turn(flat=False)
    scan = taken(poses, 3, 3)
    object.__setattr__(scan, "beam_times_ns", np.full(scan.size, STAMP))
    assert deskew(scan, poses.at(STAMP, 0), asked(poses)) == (scan, 0)
    for name in ("beam_times_ns", "stamp_ns"):
        less = taken(poses, 3, 3)
        object.__setattr__(less, name, None)
        assert deskew(less, poses.at(STAMP, 0), asked(poses)) == (less, 0)
