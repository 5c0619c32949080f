# SPDX-License-Identifier: Apache-2.0
"""Poses at many times against one time after the other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.errors import InputError
from oddsmap.poses.at_times import PoseArray, PoseTrack
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError, Trajectory

S = 10**9
START = 1_700_000_000 * S


def random_pose(rng: np.random.Generator) -> Pose3:
    q = rng.normal(size=4)
    return Pose3.from_quaternion_xyzw(rng.uniform(-50, 50, 3), q / np.linalg.norm(q))


def drive(seed: int, count: int = 12, *, start: int = START, gap: int = S // 10) -> Trajectory:
    """Poses at uneven times, in any order, some of them repeated: where the robot stands still."""
    rng = np.random.default_rng(seed)
    stamps = start + np.cumsum(rng.integers(1, gap, count))
    poses = [random_pose(rng)]
    for _ in range(count - 1):
        step = random_pose(rng)
        moved = poses[-1] @ Pose3(0.02 * step.translation, step.rotation)
        poses.append(poses[-1] if rng.random() < 0.3 else moved)
    order = rng.permutation(count)
    return Trajectory(
        np.array([pose.translation for pose in poses])[order],
        np.array([pose.rotation for pose in poses])[order],
        stamps[order],
    )


def slow(poses: Trajectory, time: int, tolerance: int) -> Pose3 | None:
    """One time; None where nothing is known."""
    assert poses.stamps_ns is not None
    if not poses.stamps_ns.min() <= time <= poses.stamps_ns.max():
        return None
    try:
        return poses.at(time, tolerance)
    except NoPoseError:
        return None


@given(st.integers(0, 10_000), st.sampled_from([S // 100, S // 30, S]), st.sampled_from([0, START]))
@settings(max_examples=60)
def test_many_times_equal_one_after_the_other(seed: int, tolerance: int, start: int) -> None:
    poses = drive(seed, start=start - S)
    assert poses.stamps_ns is not None
    rng = np.random.default_rng(seed + 1)
    low, high = int(poses.stamps_ns.min()), int(poses.stamps_ns.max())
    times = np.append(rng.integers(low - S // 10, high + S // 10, 60), poses.stamps_ns)
    rng.shuffle(times)
    found = PoseTrack(poses).at(times, tolerance)
    assert len(found) == len(times)
    for i, time in enumerate(times.tolist()):
        want = slow(poses, time, tolerance)
        assert found.known[i] == (want is not None)
        if want is not None:
            np.testing.assert_allclose(found.rotations[i], want.rotation, rtol=0, atol=1e-14)
            np.testing.assert_array_equal(found.positions[i], want.translation)


def test_between_poses_of_the_same_bits_there_is_no_other() -> None:
    pose = random_pose(np.random.default_rng(3))
    poses = Trajectory(
        np.array([pose.translation] * 3),
        np.array([pose.rotation] * 3),
        np.array([START, START + S, START + 2 * S]),
    )
    times = START + np.arange(0, 2 * S, S // 7 - 1)
    found = PoseTrack(poses).at(times, S)
    assert found.known.all()
    for i, time in enumerate(times.tolist()):
        for one in (poses.at(time, S), Pose3(found.positions[i], found.rotations[i])):
            np.testing.assert_array_equal(one.rotation, pose.rotation)
            np.testing.assert_array_equal(one.translation, pose.translation)


def test_a_stamp_with_two_poses_is_not_known() -> None:
    stamps = np.array([0, S, S, 2 * S, 2 * S])
    places = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [3, 0, 0]])
    track = PoseTrack(Trajectory(places, np.array([np.eye(3)] * 5), stamps))
    found = track.at(np.array([S, S // 2, 3 * S // 2, 2 * S]), S)
    assert found.known.tolist() == [False, True, True, True]
    assert found.positions[1:, 0].tolist() == [0.5, 2.5, 3.0]


def test_stamps_as_far_apart_as_there_are() -> None:
    ends = np.array([-(2**63), 2**63 - 1])
    track = PoseTrack(
        Trajectory(np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([np.eye(3)] * 2), ends)
    )
    found = track.at(np.array([-(2**63), 0, 2**63 - 1]), S)
    assert found.known.tolist() == [True, False, True]


def test_composed_and_inverted_as_single_poses_are() -> None:
    rng = np.random.default_rng(0)
    ones, others = ([random_pose(rng) for _ in range(20)] for _ in range(2))

    def array(poses: list[Pose3]) -> PoseArray:
        return PoseArray(
            np.array([pose.rotation for pose in poses]),
            np.array([pose.translation for pose in poses]),
            np.ones(len(poses), np.bool_),
        )

    both, back = array(ones) @ array(others), array(ones).inverse()
    fixed = array(ones) @ PoseArray.fixed(others[0], 20)
    for i, (one, other) in enumerate(zip(ones, others, strict=True)):
        wanted = [(both, one @ other), (back, one.inverse()), (fixed, one @ others[0])]
        for found, want in wanted:
            np.testing.assert_array_equal(found.rotations[i], want.rotation)
            np.testing.assert_array_equal(found.positions[i], want.translation)


def test_spacing_and_poses_without_stamps() -> None:
    places, turns = np.zeros((4, 3)), np.array([np.eye(3)] * 4)
    stamps = np.array([0, 20, 40, 1000]) * 10**6
    assert PoseTrack(Trajectory(places, turns, stamps)).spacing_ns == 20e6
    assert PoseTrack(Trajectory(places[:1], turns[:1], stamps[:1])).spacing_ns == np.inf
    with pytest.raises(InputError, match="have no stamps"):
        PoseTrack(Trajectory(places, turns))
