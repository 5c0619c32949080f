# SPDX-License-Identifier: Apache-2.0
"""Calibrations of KITTI: odometry, raw data, and matrices for --body-from-sensor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap import open_log
from oddsmap.array_types import FloatArray
from oddsmap.cli.log_options import read_extrinsics
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3

# x ahead of the LIDAR is z of the camera, y left is -x, z up is -y.
AXES = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
PLACE = np.array([0.1, -0.2, -0.3])


def text(numbers: FloatArray) -> str:
    return " ".join(f"{value:.12g}" for value in numbers.ravel())


def tr() -> str:
    return text(np.hstack([AXES, PLACE[:, None]]))


def folder_of(path: Path, **files: str) -> Path:
    """Two scans of a wall, and a camera that moved ahead by 1 m."""
    path.mkdir(exist_ok=True)
    for i in range(2):
        points = np.tile([[5.0 - i, 0.5, 0.25, 0.1]], (60, 1)).astype("<f4")
        (path / f"{i:06d}.bin").write_bytes(points.tobytes())
    (path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 1\n")
    for name, content in files.items():
        (path / f"{name}.txt").write_text(content)
    return path


def places(path: Path) -> FloatArray:
    log = open_log(path, columns="x,y,z,intensity")
    return np.array([scan.map_from_sensor.translation for scan in log])


def test_raw_data_have_a_rotation_and_a_place(tmp_path: Path) -> None:
    """The same as Tr of the odometry benchmark."""
    raw = f"calib_time: 15-Mar-2012 11:37:16\nR: {text(AXES)}\nT: {text(PLACE)}\ndelta_f: 0 0\n"
    one = folder_of(tmp_path / "odometry", calib=f"P0: 1 2 3\nTr: {tr()}\n")
    other = folder_of(tmp_path / "raw", calib_velo_to_cam=raw)
    np.testing.assert_allclose(places(one), [[0, 0, 0], [1, 0, 0]], atol=1e-12)
    np.testing.assert_array_equal(places(other), places(one))


def test_raw_data_are_rectified_where_that_is_known(tmp_path: Path) -> None:
    c, s = np.cos(0.1), np.sin(0.1)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    path = folder_of(
        tmp_path,
        calib_velo_to_cam=f"R: {text(AXES)}\nT: {text(PLACE)}\n",
        calib_cam_to_cam=f"S_00: 1 2\nR_rect_00: {text(turn)}\n",
    )
    np.testing.assert_allclose(places(path)[1], AXES.T @ turn.T @ [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("R: 1 0 0 0 1 0 0 0 1\nT: 1 2\n", r"R: and T: have 9 and 2 numbers, not 9 and 3"),
        ("R: 2 0 0 0 1 0 0 0 1\nT: 1 2 3\n", r":1: R: a rotation matrix is not orthonormal"),
        ("Tr: 1 2 3\n", r":1: Tr: a pose needs 12 or 16 numbers"),
    ],
)
def test_a_bad_calibration_is_one_line(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        places(folder_of(tmp_path, calib_velo_to_cam=content))


@pytest.mark.parametrize(
    "content",
    [
        "\n".join(text(row) for row in np.eye(4) + np.outer([1, 0, 0, 0], [0, 0, 0, 2])),
        "1 0 0 2 0 1 0 0 0 0 1 0\n",
        "P0: 7\nTr: 1 0 0 2 0 1 0 0 0 0 1 0\n",
        "calib_time: x\nR: 1 0 0 0 1 0 0 0 1\nT: 2 0 0\n",
    ],
)
def test_extrinsics_may_be_a_file(tmp_path: Path, content: str) -> None:
    path = tmp_path / "body_from_sensor.txt"
    path.write_text(content)
    pose = read_extrinsics(str(path))
    assert pose is not None
    np.testing.assert_array_equal(pose.translation, [2, 0, 0])
    np.testing.assert_array_equal(pose.rotation, np.eye(3))


def test_extrinsics_that_say_nothing(tmp_path: Path) -> None:
    path = tmp_path / "c.txt"
    path.write_text("P0: 1 2 3\n")
    with pytest.raises(InputError, match=r"c\.txt: no line Tr: or .* that would say"):
        read_extrinsics(str(path))


def test_positions_alone_place_points_of_the_map(tmp_path: Path) -> None:
    path = folder_of(tmp_path)
    (path / "poses.txt").unlink()
    track = tmp_path / "track.csv"
    track.write_text("x,y,z\n1,0,0.25\n2,0,0.25\n")
    columns = "x,y,z,intensity"
    log = open_log(path, poses=track, points_in="map", columns=columns)
    scan = next(iter(log))
    np.testing.assert_array_equal(scan.map_from_sensor.translation, [1, 0, 0.25])
    np.testing.assert_allclose(scan.directions[0] * scan.ranges[0], [4, 0.5, 0])
    with pytest.raises(InputError, match=r"without rotations .* which do only for points"):
        open_log(path, poses=track, columns=columns)
    arm = Pose3(np.array([0.5, 0, 0]), np.eye(3))
    with pytest.raises(InputError, match="do not say where a sensor beside them was"):
        open_log(path, poses=track, points_in="map", columns=columns, body_from_sensor=arm)
