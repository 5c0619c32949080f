# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose3
from oddsmap.scans.depth_image import DepthScan, PinholeCamera

CAMERA = PinholeCamera(fx=4.0, fy=2.0, cx=1.0, cy=0.5, width=3, height=2)
HERE = Pose3(np.zeros(3), np.eye(3))


def test_directions_are_row_by_row_and_point_through_the_pixels() -> None:
    assert CAMERA.directions.shape == (6, 3)
    np.testing.assert_allclose(np.linalg.norm(CAMERA.directions, axis=1), 1.0, rtol=1e-15)
    # Row 1, column 0: x = (0 - 1) / 4 to the left; row 1: y = (1 - 0.5) / 2 down.
    ray = CAMERA.directions[1 * 3 + 0]
    np.testing.assert_allclose(ray / ray[2], [-0.25, 0.25, 1.0], rtol=1e-15)
    ray = CAMERA.directions[1 * 3 + 2]
    np.testing.assert_allclose(ray / ray[2], [0.25, 0.25, 1.0], rtol=1e-15)


def test_equal_cameras_share_directions_that_cannot_be_written_to() -> None:
    assert PinholeCamera(4.0, 2.0, 1.0, 0.5, 3, 2).directions is CAMERA.directions
    with pytest.raises(ValueError, match="read-only"):
        CAMERA.directions[0, 0] = 1.0


def test_depth_is_along_z_and_range_along_the_ray() -> None:
    depth = np.array([[1, 2, 3], [4, 5, 6]], np.float32)
    scan = DepthScan(HERE, depth, CAMERA, 7).to_scan()
    points = scan.directions * scan.ranges[:, None]
    np.testing.assert_allclose(points[:, 2], [1, 2, 3, 4, 5, 6], rtol=1e-15)
    np.testing.assert_allclose(points[5], [1.5, 1.5, 6], rtol=1e-15)
    assert scan.stamp_ns == 7
    assert scan.directions is CAMERA.directions


@pytest.mark.parametrize("value", [0.0, -0.0, np.nan, -1.0, np.inf, -np.inf])
def test_pixels_without_information_are_nan(value: float) -> None:
    depth = np.full((2, 3), 2.0, np.float32)
    depth[1, 0] = value
    ranges = DepthScan(HERE, depth, CAMERA).to_scan().ranges
    assert np.isnan(ranges).tolist() == [False, False, False, True, False, False]


def test_an_image_of_another_size_names_both() -> None:
    with pytest.raises(
        InputError, match="depth image is 2 x 3 pixels, the intrinsics are for 3 x 2"
    ):
        DepthScan(HERE, np.ones((3, 2), np.float32), CAMERA)


@pytest.mark.parametrize(
    "field", [{"fx": 0.0}, {"fy": np.nan}, {"cx": np.inf}, {"width": 0}, {"height": 1.5}]
)
def test_a_camera_that_cannot_be(field: dict[str, Any]) -> None:
    good: dict[str, Any] = {"fx": 1, "fy": 1, "cx": 0, "cy": 0, "width": 1, "height": 1}
    with pytest.raises(ConfigError, match=rf"camera\.{next(iter(field))} is a"):
        PinholeCamera(**(good | field))
