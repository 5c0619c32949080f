# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.scans.scan import Scan

HERE = Pose3(np.zeros(3), np.eye(3))
ANY = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False, width=32)


@given(st.lists(st.tuples(ANY, ANY, ANY), max_size=8))
def test_the_ends_of_the_beams_are_the_points(points: list[tuple[float, ...]]) -> None:
    given_points = np.array(points, np.float64).reshape(-1, 3)
    scan = Scan.from_points(HERE, given_points)
    ends = scan.directions * scan.ranges[:, None]
    size = np.abs(given_points).max(axis=1, initial=0.0)[:, None]
    assert (np.abs(ends - given_points) <= 1e-15 * np.maximum(size, 0)).all()
    np.testing.assert_allclose(np.linalg.norm(scan.directions, axis=1), 1.0, rtol=1e-15)


def test_points_without_a_distance() -> None:
    huge = 1.7e308
    points: list[list[float]] = [
        [np.nan, 1, 2],
        [0, 0, 0],
        [np.inf, 0, 0],
        [huge, huge, huge],
        [1e200, 0, 0],
    ]
    scan = Scan.from_points(HERE, points, 5)
    np.testing.assert_array_equal(scan.ranges, [np.nan, 0, np.nan, np.nan, 1e200])
    np.testing.assert_array_equal(scan.directions, [[1, 0, 0]] * 5)
    assert scan.stamp_ns == 5


def test_points_of_another_shape() -> None:
    with pytest.raises(
        InputError, match=r"points of a scan have shape \(n, 3\) with a 3D pose, got \(4, 2\)"
    ):
        Scan.from_points(HERE, np.ones((4, 2)))
