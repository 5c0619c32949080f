# SPDX-License-Identifier: Apache-2.0
"""Every form of a pose is the pose that it says, and what is none is refused in one line."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.errors import InputError
from oddsmap.poses.given_pose import pose_of
from oddsmap.poses.pose import Pose2, Pose3

NUMBER = st.floats(-100.0, 100.0)
ANGLE = st.floats(-3.0, 3.0)


@given(NUMBER, NUMBER, ANGLE)
def test_all_forms_in_the_plane_are_one_pose(x: float, y: float, yaw: float) -> None:
    wanted = Pose2(x, y, yaw)
    same: list[Any] = [(x, y, yaw), [x, y, yaw], np.array([x, y, yaw]), wanted]
    c, s = math.cos(yaw), math.sin(yaw)
    for form in same:
        assert pose_of(form) == wanted
    matrix = [[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]]
    for rows in (matrix, np.array(matrix)):
        found = pose_of(rows)
        assert isinstance(found, Pose2)
        assert (found.x, found.y) == (x, y)
        assert found.theta == pytest.approx(yaw, abs=1e-12)


@given(st.lists(NUMBER, min_size=3, max_size=3), st.lists(NUMBER, min_size=4, max_size=4))
def test_all_forms_in_space_are_one_pose(position: list[float], q: list[float]) -> None:
    norm = math.hypot(*q)
    if norm < 1e-3:
        return
    x, y, z, w = (value / norm for value in q)
    # By the definition, v -> q v q*, column by column.
    rotation = np.column_stack([turned((w, x, y, z), axis) for axis in np.eye(3).tolist()])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    forms: list[Any] = [
        {"position": position, "xyzw": (x, y, z, w)},
        {"position": np.array(position), "wxyz": [w, x, y, z]},
        matrix,
        matrix.tolist(),
        matrix[:3],
        Pose3(np.array(position), rotation),
    ]
    for form in forms:
        found = pose_of(form)
        assert isinstance(found, Pose3)
        np.testing.assert_allclose(found.rotation, rotation, atol=1e-12)
        np.testing.assert_array_equal(found.translation, position)


def turned(q: tuple[float, ...], v: list[float]) -> list[float]:
    def times(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
        aw, ax, ay, az = a
        bw, bx, by, bz = b
        return (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        )

    w, x, y, z = q
    return list(times(times(q, (0.0, *v)), (w, -x, -y, -z))[1:])


TRANSPOSED = np.eye(4)
TRANSPOSED[3, :3] = 1.0, 2.0, 3.0


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ((1.0, 2.0), r"a pose is \(x, y, yaw\), .* got numbers of shape \(2,\)"),
        ((1, 2, 3, 0, 0, 0, 1), r"got numbers of shape \(7,\)"),
        (((1, 2, 3), (0, 0, 0, 1)), "does not say the order of the quaternion: name it"),
        ("here", r"got 'here' \(str\)"),
        (None, "a pose is"),
        ({"position": (0, 0, 0), "quaternion": (0, 0, 0, 1)}, "by name"),
        ({"position": (0, 0), "xyzw": (0, 0, 0, 1)}, r"position is 3 numbers, got shape \(2,\)"),
        ({"position": (0, 0, 0), "xyzw": "abcd"}, "xyzw is 4 numbers, got 'abcd'"),
        ({"position": (0, 0, 0), "wxyz": (0, 0, 0, 2)}, "unit quaternion, got norm 2"),
        (TRANSPOSED, "the last row of a 4 x 4 pose is 0 0 0 1, got 1 2 3 1: transpose it"),
        (np.diag([1.0, -1.0, 1.0]), "left-handed"),
        (np.diag([2.0, 2.0, 1.0]), "not orthonormal"),
        ([[1, 0, 0], [0, 0, -1], [0, 1, 0]], "a rotation in space needs a position"),
    ],
)
def test_what_is_no_pose(wrong: Any, says: str) -> None:
    with pytest.raises(InputError, match=says):
        pose_of(wrong)


@pytest.mark.parametrize(
    "form", [(math.nan, 0, 0), np.full((3, 3), np.nan), np.full((4, 4), -np.inf)]
)
def test_poses_that_are_not_finite_are_left_to_be_counted(form: Any) -> None:
    assert not pose_of(form).is_finite


def test_the_order_of_a_quaternion_has_to_be_named() -> None:
    for names in ({}, {"xyzw": (0, 0, 0, 1), "wxyz": (1, 0, 0, 0)}):
        with pytest.raises(InputError, match="one quaternion, xyzw= or wxyz="):
            Pose3.from_quaternion((0, 0, 0), **names)


def test_the_parts_of_a_pose_in_another_order() -> None:
    with pytest.raises(InputError, match=r"translation \(3,\) and a rotation \(3, 3\), in this"):
        Pose3(np.eye(3), np.zeros(4))
    with pytest.raises(InputError, match="2 x 3 or 3 x 3"):
        Pose2.from_matrix(np.eye(4))


def test_the_older_order_of_a_pose_is_told_by_its_shapes() -> None:
    one = Pose3(np.arange(3.0), np.eye(3))
    other = Pose3(np.eye(3), np.arange(3.0))
    assert np.array_equal(one.translation, other.translation)
    assert np.array_equal(one.rotation, other.rotation)
