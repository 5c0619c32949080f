# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError, Trajectory

S = 10**9


def turn(axis: list[float], angle: float) -> np.ndarray:
    """Rotation by Rodrigues' formula."""
    a = np.array(axis) / np.linalg.norm(axis)
    k = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.asarray(np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k)


def path_of(angles: list[float], stamps: list[int], axis: list[float]) -> Trajectory:
    return Trajectory(
        positions=np.array([[float(i), 10.0 * i, 0.0] for i in range(len(angles))]),
        rotations=np.array([turn(axis, angle) for angle in angles]),
        stamps_ns=np.array(stamps, np.int64),
        path="p.txt",
    )


@given(
    start=st.floats(-3, 3),
    change=st.floats(-3.1, 3.1),
    fraction=st.integers(1, S - 1),
    axis=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda a: math.hypot(*a) > 0.1),
)
def test_between_two_poses_the_turn_is_even(
    start: float, change: float, fraction: int, axis: tuple[float, ...]
) -> None:
    poses = path_of([start, start + change], [0, S], list(axis))
    pose = poses.at(fraction, S)
    f = fraction / S
    np.testing.assert_allclose(pose.rotation, turn(list(axis), start + f * change), atol=1e-9)
    np.testing.assert_allclose(pose.translation, [f, 10 * f, 0], atol=1e-12)


def test_a_stamp_that_is_there_gives_the_pose_itself() -> None:
    stamps = [1577836980_099104601, 1577836980_099104602, 1577836980_099104603]
    poses = path_of([0.1, 0.2, 0.3], stamps, [0, 0, 1])
    for i, stamp in enumerate(stamps):
        pose = poses.at(stamp, 0)
        np.testing.assert_array_equal(pose.rotation, poses.rotations[i])
        np.testing.assert_array_equal(pose.translation, poses.positions[i])


def test_the_order_of_the_file_does_not_matter_to_stamps() -> None:
    poses = path_of([0.0, 0.0, 0.0], [2 * S, 0, S], [0, 0, 1])
    assert poses.at(S // 2, S).translation[0] == 1.5  # between poses 1 (0 s) and 2 (1 s)
    assert [pose.translation[0] for pose in poses] == [0, 1, 2]


def test_the_nearest_pose_without_interpolation_and_at_the_ends() -> None:
    poses = path_of([0.0, 0.0], [0, S], [0, 0, 1])
    assert poses.at(S // 4, S, interpolate=False).translation[0] == 0
    assert poses.at(3 * S // 4, S, interpolate=False).translation[0] == 1
    assert poses.at(S // 2, S, interpolate=False).translation[0] == 0
    assert poses.at(-5, 5).translation[0] == 0
    assert poses.at(S + 5, 5).translation[0] == 1


@pytest.mark.parametrize("stamp", [-6, S + 6, 6, S - 6])
@pytest.mark.parametrize("interpolate", [True, False])
def test_beyond_the_tolerance_nothing_is_guessed(stamp: int, interpolate: bool) -> None:
    poses = path_of([0.0, 0.0], [0, S], [0, 0, 1])
    poses.at(stamp, 6, interpolate=interpolate)
    with pytest.raises(
        NoPoseError, match=r"p\.txt: no pose within 5e-09 s of stamp .*6e-09 s away"
    ):
        poses.at(stamp, 5, interpolate=interpolate)


def test_the_message_has_all_digits_of_the_stamp() -> None:
    poses = path_of([0.0], [0], [0, 0, 1])
    with pytest.raises(NoPoseError, match=r"stamp 1577836980\.099104601, the nearest"):
        poses.at(1577836980_099104601, S)


def test_two_poses_of_one_stamp() -> None:
    same = path_of([0.0, 0.0, 0.1], [5, 6, 6], [0, 0, 1])
    assert same.at(5, 0).translation[0] == 0
    with pytest.raises(InputError, match="poses 2 and 3 differ and both have the stamp"):
        same.at(6, 0)
    twice = Trajectory(np.ones((2, 3)), np.array([np.eye(3)] * 2), np.array([6, 6]))
    assert twice.at(6, 0).translation[0] == 1


def test_what_does_not_fit() -> None:
    eye = np.array([np.eye(3)] * 2)
    with pytest.raises(InputError, match="no poses"):
        Trajectory(np.empty((0, 3)), np.empty((0, 3, 3)))
    with pytest.raises(InputError, match=r"got \(2, 3\) and \(1, 3, 3\)"):
        Trajectory(np.ones((2, 3)), eye[:1])
    with pytest.raises(InputError, match="2 poses need 2 stamps in int64"):
        Trajectory(np.ones((2, 3)), eye, np.array([1.0, 2.0]))
    with pytest.raises(InputError, match="no stamps to look them up by"):
        Trajectory(np.ones((2, 3)), eye).at(0, 0)
    assert isinstance(Trajectory(np.ones((2, 3)), eye)[1], Pose3)
