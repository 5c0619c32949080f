# SPDX-License-Identifier: Apache-2.0
"""Poses and beams come out the same on every CPU: as plain Python sums them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap.forward.beams import Beams
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.poses.product import inverse, product
from oddsmap.scans.scan import Scan

FloatArray = npt.NDArray[np.float64]
RNG = np.random.default_rng(3)


def by_hand(a: FloatArray, b: FloatArray) -> list[list[float]]:
    def total(row: Sequence[float], column: Sequence[float]) -> float:
        found = row[0] * column[0]
        for x, y in zip(row[1:], column[1:], strict=True):
            found += x * y
        return found

    return [[total(row, column) for column in b.T.tolist()] for row in a.tolist()]


def rotation() -> FloatArray:
    q = RNG.normal(size=4)
    return Pose3.from_quaternion_xyzw(np.zeros(3), q / np.linalg.norm(q)).rotation


@pytest.mark.parametrize("d", [2, 3])
def test_products(d: int) -> None:
    a, b = RNG.normal(size=(1000, d)), RNG.normal(size=(d, d))
    assert product(a, b).tolist() == by_hand(a, b)
    # Not so for BLAS, where the CPU fuses: why this function is there.
    np.testing.assert_allclose(product(a, b), a @ b, rtol=1e-12, atol=1e-14)


def test_poses_in_space() -> None:
    for _ in range(50):
        one, other = (Pose3(rotation=rotation(), translation=RNG.normal(size=3)) for _ in range(2))
        points = RNG.normal(size=(20, 3))
        moved = np.array(by_hand(points, one.rotation.T)) + one.translation
        assert one.transform(points).tolist() == moved.tolist()
        both = one @ other
        assert both.rotation.tolist() == by_hand(one.rotation, other.rotation)
        assert both.translation.tolist() == one.transform(other.translation[None])[0].tolist()
        back = by_hand(-one.translation[None], one.rotation)[0]
        assert one.inverse().translation.tolist() == back


def test_poses_in_the_plane() -> None:
    pose, points = Pose2(0.3, -1.7, 0.77), RNG.normal(size=(500, 2))
    moved = np.array(by_hand(points, pose.rotation.T)) + pose.translation
    assert pose.transform(points).tolist() == moved.tolist()
    x, y = by_hand(-pose.translation[None], pose.rotation)[0]
    assert (pose.inverse().x, pose.inverse().y) == (x, y)


def test_beams_of_the_forward_model() -> None:
    turn = rotation()
    directions = RNG.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    beams, _ = Beams.from_scans([Scan(Pose3(np.zeros(3), turn), directions, np.ones(300))])
    assert beams.directions.tolist() == by_hand(directions, turn.T)


def test_the_inverse() -> None:
    for _ in range(100):
        matrix = RNG.normal(size=(3, 3))
        found = inverse(matrix)
        assert found is not None
        np.testing.assert_allclose(found @ matrix, np.eye(3), atol=1e-9)
    assert inverse(np.ones((3, 3))) is None


def test_what_is_not_finite_stays_so_without_a_warning() -> None:
    moved = Pose3(np.zeros(3), np.eye(3)).transform(np.array([[np.inf, 1.0, np.nan]]))
    assert not np.isfinite(moved).any()
