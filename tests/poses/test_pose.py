# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import Pose2, Pose3, Scan
from oddsmap.errors import InputError

number = st.floats(-100.0, 100.0, allow_subnormal=False)
poses2 = st.builds(Pose2, number, number, st.floats(-7.0, 7.0))


@st.composite
def poses3(draw: st.DrawFn) -> Pose3:
    q = np.array((*draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3)), 1.0))
    t = draw(st.tuples(number, number, number))
    return Pose3.from_quaternion_xyzw(t, q / np.linalg.norm(q))


def test_the_plane_by_hand() -> None:
    """A sensor at (1, 2) that looks along y: what is ahead of it is at larger y, left of it -x."""
    map_from_sensor = Pose2(1.0, 2.0, math.pi / 2)
    got = map_from_sensor.transform(np.array([[3.0, 0.0], [0.0, 3.0]]))
    assert np.allclose(got, [[1.0, 5.0], [-2.0, 2.0]])


def test_space_by_hand() -> None:
    half = math.sqrt(0.5)
    turns = {  # about z, x and y: 90 degrees, right-handed
        (0.0, 0.0, half, half): [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        (half, 0.0, 0.0, half): [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
        (0.0, half, 0.0, half): [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
    }
    for xyzw, images in turns.items():
        pose = Pose3.from_quaternion_xyzw((1.0, 2.0, 3.0), xyzw)
        assert np.allclose(pose.transform(np.eye(3)), np.add(images, [1.0, 2.0, 3.0]))


@given(poses2, poses2)
def test_compose_and_invert_in_the_plane(one: Pose2, other: Pose2) -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [-2.0, 5.0]])
    both = (one @ other).transform(points)
    assert np.allclose(both, one.transform(other.transform(points)), atol=1e-9)
    assert np.allclose(one.inverse().transform(one.transform(points)), points, atol=1e-9)


@given(poses3(), poses3())
def test_compose_and_invert_in_space(one: Pose3, other: Pose3) -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 3.0], [-2.0, 5.0, 1.0]])
    both = (one @ other).transform(points)
    assert np.allclose(both, one.transform(other.transform(points)), atol=1e-9)
    assert np.allclose(one.inverse().transform(one.transform(points)), points, atol=1e-9)
    assert np.allclose(one.rotation @ one.rotation.T, np.eye(3))
    assert math.isclose(float(np.linalg.det(one.rotation)), 1.0)


def test_from_matrix() -> None:
    pose = Pose3.from_quaternion_xyzw((1.0, 2.0, 3.0), (0.0, 0.6, 0.0, 0.8))
    upper = np.column_stack([pose.rotation, pose.translation])
    for matrix in (upper, upper.ravel(), np.vstack([upper, [0, 0, 0, 1]]), upper.ravel().tolist()):
        got = Pose3.from_matrix(matrix)
        assert np.array_equal(got.rotation, pose.rotation)
        assert np.array_equal(got.translation, pose.translation)
    for count in (9, 11, 13):
        with pytest.raises(InputError, match=f"12 or 16 numbers .* got {count}"):
            Pose3.from_matrix(np.zeros(count))


def test_rotations_that_are_none() -> None:
    flip = np.hstack([np.diag([1.0, 1.0, -1.0]), np.zeros((3, 1))])
    with pytest.raises(InputError, match="left-handed"):
        Pose3.from_matrix(flip)
    with pytest.raises(InputError, match="not orthonormal"):
        Pose3.from_matrix(np.hstack([np.eye(3) * 1.01, np.zeros((3, 1))]))
    rounded = np.hstack([np.eye(3) + 1e-5, np.zeros((3, 1))])
    assert Pose3.from_matrix(rounded).is_finite
    for bad in ((0.0, 0.0, 0.0, 2.0), (0.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3, 0.4)):
        with pytest.raises(InputError, match="unit quaternion"):
            Pose3.from_quaternion_xyzw((0.0, 0.0, 0.0), bad)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_is_finite(bad: float) -> None:
    assert Pose2(1.0, 2.0, 3.0).is_finite
    for values in ((bad, 0.0, 0.0), (0.0, bad, 0.0), (0.0, 0.0, bad)):
        assert not Pose2(*values).is_finite
    matrix = np.eye(4)
    assert Pose3.from_matrix(matrix).is_finite
    for at in ((0, 0), (2, 1), (1, 3)):
        broken = matrix.copy()
        broken[at] = bad
        assert not Pose3.from_matrix(broken).is_finite
    quaternion = Pose3.from_quaternion_xyzw((0.0, 0.0, 0.0), (bad, 0.0, 0.0, 1.0))
    assert not quaternion.is_finite


def test_scans_check_their_shapes() -> None:
    plane, space = Pose2(0.0, 0.0, 0.0), Pose3.from_matrix(np.eye(4))
    Scan(plane, np.zeros((3, 2)), np.zeros(3))
    Scan(space, np.zeros((3, 3)), np.zeros(3))
    for pose, directions, ranges in (
        (plane, np.zeros((3, 3)), np.zeros(3)),
        (space, np.zeros((3, 2)), np.zeros(3)),
        (plane, np.zeros((3, 2)), np.zeros(4)),
        (plane, np.zeros((3, 2)), np.zeros((3, 1))),
        (plane, np.zeros(6), np.zeros(3)),
    ):
        with pytest.raises(InputError, match="a scan with a"):
            Scan(pose, directions, ranges)
