# SPDX-License-Identifier: Apache-2.0
"""Scans from what sensors give; what cannot be right is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oddsmap
from oddsmap import DepthScan, GridScan, InputError, PinholeCamera, Pose2, Pose3, Scan

NUMBER = st.floats(-50.0, 50.0)
CAMERA = PinholeCamera(2.0, 2.0, 0.5, 0.5, width=2, height=2)


@given(
    st.tuples(NUMBER, NUMBER, st.floats(-3.0, 3.0)),
    st.lists(st.tuples(st.floats(-6.0, 6.0), st.floats(0.1, 50.0)), min_size=1, max_size=9),
)
def test_angles_and_points_mean_the_same_places(
    pose: tuple[float, float, float], readings: list[tuple[float, float]]
) -> None:
    angles, ranges = zip(*readings, strict=True)
    scan = Scan.from_angles(pose, angles, ranges, stamp_s=2)
    x, y, yaw = pose
    ends = [(x + r * math.cos(yaw + angle), y + r * math.sin(yaw + angle)) for angle, r in readings]
    found = scan.map_from_sensor.transform(scan.directions * scan.ranges[:, None])
    np.testing.assert_allclose(found, ends, atol=1e-12)
    cloud = Scan.from_points(pose, ends, points_in="map", stamp_s=2)
    assert cloud.measured_points is not None
    np.testing.assert_allclose(
        cloud.map_from_sensor.transform(cloud.measured_points), ends, atol=1e-12
    )
    np.testing.assert_allclose(cloud.ranges, ranges, atol=1e-12)
    again = Scan(pose, scan.directions.tolist(), list(ranges), 2_000_000_000)  # type: ignore[arg-type]
    assert again.map_from_sensor == scan.map_from_sensor == Pose2(*pose)
    np.testing.assert_array_equal(again.directions, scan.directions)
    assert again.stamp_ns == scan.stamp_ns == cloud.stamp_ns == 2_000_000_000


@given(st.lists(st.tuples(NUMBER, NUMBER, NUMBER), min_size=1, max_size=9), st.floats(-3.0, 3.0))
def test_points_of_the_map_in_space(points: list[tuple[float, ...]], roll: float) -> None:
    c, s = math.cos(roll), math.sin(roll)
    pose = np.array([[1, 0, 0, 3], [0, c, -s, 4], [0, s, c, 5], [0, 0, 0, 1]])
    scan = Scan.from_points(pose, points, points_in="map")
    assert scan.measured_points is not None
    np.testing.assert_allclose(
        scan.map_from_sensor.transform(scan.measured_points), points, atol=1e-12
    )


def test_a_flat_laser_in_space() -> None:
    scan = Scan.from_angles(np.eye(4), [0.0, np.pi / 2], [1.0, 2.0])
    np.testing.assert_allclose(scan.directions, [[1, 0, 0], [0, 1, 0]], atol=1e-15)


def test_a_cone_states_its_width_and_is_mapped_as_one() -> None:
    scan = Scan.from_cone((0.0, 0.0, 0.0), 0.0, 2.0, cone_deg=30)
    assert scan.stated == {"cone_deg": 30.0}
    assert scan.ranges.tolist() == [2.0]
    sensor = oddsmap.build_map(scan, 0.1).sensor
    assert isinstance(sensor, oddsmap.ConeSensor)
    assert sensor.cone_deg == 30.0


@pytest.mark.parametrize(
    "camera", [CAMERA, (2.0, 2.0, 0.5, 0.5), [[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]]]
)
def test_depth_images(camera: Any) -> None:
    millimetres = np.array([[1000, 2000], [0, 1500]], np.uint16)
    scan = DepthScan.from_depth(np.eye(4), millimetres, camera, depth_unit=0.001, stamp_ns=7)
    assert isinstance(scan, DepthScan)
    assert scan.camera == CAMERA
    np.testing.assert_allclose(scan.depth, [[1.0, 2.0], [0.0, 1.5]])
    same = DepthScan.from_depth(np.eye(4), [[1.0, 2.0], [0.0, 1.5]], camera, stamp_s=7e-9)
    np.testing.assert_array_equal(same.depth, scan.depth)
    assert same.stamp_ns == scan.stamp_ns == 7


def test_what_is_masked_says_nothing() -> None:
    ranges = np.ma.masked_greater(np.array([1.0, 90.0]), 80.0)
    scan = Scan.from_angles((0, 0, 0), [0.0, 1.0], ranges)
    np.testing.assert_array_equal(scan.ranges, [1.0, np.nan])


def test_directions_without_a_length_where_nothing_is_said() -> None:
    scan = Scan(Pose2(0.0, 0.0, 0.0), np.zeros((3, 2)), np.array([np.nan, -np.inf, 0.0]))
    assert scan.size == 3
    assert Scan(Pose2(0.0, 0.0, 0.0), np.empty((0, 2)), np.empty(0)).size == 0


@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=20), st.floats(1e-9, 1e3))
def test_lengths_near_one_alone_are_taken(angles: list[float], length: float) -> None:
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ranges = np.ones(len(angles))
    Scan(Pose2(0, 0, 0), unit, ranges)
    Scan(Pose2(0, 0, 0), unit.astype(np.float32), ranges)
    scaled = unit.copy()
    scaled[-1] *= length
    if abs(length - 1.0) > 1e-5:
        with pytest.raises(InputError, match=f"direction of beam {len(angles) - 1} has length"):
            Scan(Pose2(0, 0, 0), scaled, ranges)
        assert Scan(Pose2(0, 0, 0), scaled, ranges, trusted=True).size == len(angles)


def test_what_is_no_scan() -> None:
    here: Any = (0.0, 0.0, 0.0)
    space: Any = np.eye(4)
    wrong: list[tuple[Any, str]] = [
        (lambda: Scan(here, [[3.0, 4.0]], [1.0]), "beam 0 has length 5: directions are unit"),  # type: ignore[arg-type]
        (lambda: Scan(here, [[1.0, 0.0]], [1.0], 0.5), "stamp_ns is a whole number"),  # type: ignore[arg-type]
        (lambda: Scan(here, [1.0, 0.0], 1.0), r"ranges \(n,\) and directions"),  # type: ignore[arg-type]
        (
            lambda: Scan(here, [[1.0, 0.0]], [1.0], beam_times_ns=[0.5]),  # type: ignore[arg-type]
            "beam_times_ns are whole",
        ),
        (lambda: Scan.from_angles(here, [[0.0]], [1.0]), r"shape \(n,\), got \(1, 1\)"),
        (lambda: Scan.from_angles(here, [np.inf], [1.0]), "the angle of beam 0 is inf"),
        (lambda: Scan.from_angles(here, "ab", [1.0]), "angles: an array of numbers is needed"),
        (lambda: Scan.from_angles(here, [[0.0], [0.0, 1.0]], [1.0]), "angles: an array"),
        (lambda: Scan.from_points(here, [[1.0]]), r"\(n, 2\) with a 2D pose, got \(1, 1\)"),
        (lambda: Scan.from_points(space, [[1, 2, 3]], points_in="world"), '"sensor" or "map"'),  # type: ignore[arg-type]
        (lambda: Scan.from_cone(here, 0.0, 1.0, cone_deg=0.0), r"cone_deg is the full width"),
        (lambda: DepthScan.from_depth(here, [[1.0]], (1, 1, 0, 0)), "pose of its camera in space"),
        (lambda: DepthScan.from_depth(space, [1.0], (1, 1, 0, 0)), r"shape \(h, w\), got \(1,\)"),
        (lambda: DepthScan.from_depth(space, [[1.0]], (1, 1)), "a camera is a PinholeCamera"),
        (
            lambda: DepthScan.from_depth(space, [[1.0]], 2 * np.eye(3)),
            "the camera matrix is fx 0 cx",
        ),
        (
            lambda: DepthScan.from_depth(space, [[1.0]], (1, 1, 0, 0), depth_unit=0.0),
            "above 0, got",
        ),
        (lambda: DepthScan(space, np.ones((2, 2), np.uint16), CAMERA), "needs depth_unit"),
        (lambda: GridScan(space, np.eye(2), 0.1, (0, 0)), "a grid scan needs a pose in the plane"),
    ]
    for call, says in wrong:
        with pytest.raises(InputError, match=says):
            call()


def test_poses_of_the_other_measurements() -> None:
    assert GridScan((1, 2, 0.5), np.eye(2), 0.1, (0, 0)).map_from_sensor == Pose2(1, 2, 0.5)  # type: ignore[arg-type]
    depth = DepthScan(np.eye(4), np.ones((2, 2)), CAMERA)  # type: ignore[arg-type]
    assert isinstance(depth.map_from_sensor, Pose3)
