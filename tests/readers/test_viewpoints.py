# SPDX-License-Identifier: Apache-2.0
"""VIEWPOINT: points of the sensor's frame, or of the map's; and cameras whose poses LIDARs get."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers import open_log
from oddsmap.sensors.beam import BeamSensor
from tests.readers.clouds import end_points, pcd_bytes, ply_bytes

WALL = np.array([[5.05, 1.0, 0.5], [5.05, -1.0, 0.25], [5.05, 0.0, 2.0]])
HALF_TURN = "2.5 1 0 0 0 0 1"


def ends(path: Path, **options: Any) -> list[np.ndarray[Any, Any]]:
    """The points of each scan in the map frame."""
    scans = list(open_log(path, **options))
    return [scan.map_from_sensor.transform(end_points(scan)) for scan in scans]


def test_one_wall_in_the_map_frame_stays_one(tmp_path: Path) -> None:
    for i, place in enumerate((0.0, 1.0, 2.0)):
        content = pcd_bytes(WALL, viewpoint=f"{place} 0 0 1 0 0 0")
        (tmp_path / f"{i}.pcd").write_bytes(content)
    with pytest.raises(InputError, match="say --points-in sensor or --points-in map") as caught:
        open_log(tmp_path)
    assert "\n" not in str(caught.value)
    for points in ends(tmp_path, points_in="map"):
        np.testing.assert_allclose(points, WALL, rtol=1e-6)
    log = open_log(tmp_path, points_in="map")
    assert [scan.map_from_sensor.translation[0] for scan in log] == [0, 1, 2]
    assert log.notes == (
        "VIEWPOINT is taken for the place of the sensor; the points are in the map frame",
    )
    for shift, points in enumerate(ends(tmp_path, points_in="sensor")):
        np.testing.assert_allclose(points, WALL + np.array([shift, 0, 0]), rtol=1e-6)


@pytest.mark.parametrize("frame", ["map", "sensor"])
def test_the_likelier_frame_is_named(tmp_path: Path, frame: str) -> None:
    """Two walls of a corner, seen from places 1 m apart."""
    y, z = (axis.ravel() for axis in np.meshgrid(np.arange(-3, 3, 0.1), np.arange(0, 2, 0.1)))
    wall = np.stack([np.full_like(y, 5.05), y, z], axis=1)
    corner = np.vstack([wall, wall[:, [1, 0, 2]]])
    for i in range(4):
        points = corner if frame == "map" else corner - np.array([i, 0.5 * i, 0])
        content = pcd_bytes(points, viewpoint=f"{i} {0.5 * i} 0 1 0 0 0")
        (tmp_path / f"{i}.pcd").write_bytes(content)
    with pytest.raises(InputError) as caught:
        open_log(tmp_path)
    assert f"(points_in=); {frame} is likelier: of the cells of two clouds " in str(caught.value)
    # Nothing is said where the places are the same.
    for i in range(4):
        (tmp_path / f"{i}.pcd").write_bytes(pcd_bytes(corner, viewpoint="0 0 1.5 1 0 0 0"))
    with pytest.raises(InputError, match=r"\(points_in=\)$"):
        open_log(tmp_path)


def test_a_single_cloud_asks_as_well(tmp_path: Path) -> None:
    path = tmp_path / "a.pcd"
    path.write_bytes(pcd_bytes(WALL, viewpoint=HALF_TURN))
    with pytest.raises(InputError, match=r"a\.pcd: VIEWPOINT is not the identity, and nothing"):
        open_log(path)
    np.testing.assert_allclose(ends(path, points_in="map"), [WALL], rtol=1e-6)
    turned = WALL * np.array([-1, -1, 1]) + np.array([2.5, 1, 0])
    np.testing.assert_allclose(ends(path, points_in="sensor"), [turned], rtol=1e-6)


def test_nothing_is_asked_where_the_poses_are_in_a_file(tmp_path: Path) -> None:
    (tmp_path / "a.pcd").write_bytes(pcd_bytes(WALL, viewpoint=HALF_TURN))
    (tmp_path / "poses.txt").write_text("1 0 0 10 0 1 0 0 0 0 1 0\n")
    np.testing.assert_allclose(ends(tmp_path), [WALL + np.array([10, 0, 0])], rtol=1e-6)
    # Any cloud may be in the map frame; then the pose says where its beams began.
    (tmp_path / "a.pcd").unlink()
    (tmp_path / "a.ply").write_bytes(ply_bytes(WALL))
    np.testing.assert_allclose(ends(tmp_path, points_in="map"), [WALL], rtol=1e-6)
    (scan,) = open_log(tmp_path, points_in="map")
    np.testing.assert_array_equal(scan.map_from_sensor.translation, [10, 0, 0])


def test_the_sensor_itself_is_no_return_in_either_frame(tmp_path: Path) -> None:
    """A driver's (0, 0, 0) that a program has moved into the map, and rounded."""
    place = np.array([2.7, -1.3, 0.9])
    path = tmp_path / "a.pcd"
    path.write_bytes(pcd_bytes(np.vstack([WALL, place]), viewpoint="2.7 -1.3 0.9 1 0 0 0"))
    _, skipped = BeamSensor().segments(list(open_log(path, points_in="map")))
    assert skipped == {"beam.zero_range": 1}


def test_where_the_frame_means_nothing_it_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.pcd"
    path.write_bytes(pcd_bytes(WALL))
    with pytest.raises(InputError, match="without a pose has its points in the frame of its sen"):
        open_log(path, points_in="map")
    with pytest.raises(ConfigError, match="points_in is 'sensor' or 'map', got 'world'"):
        open_log(path, points_in="world")  # type: ignore[arg-type]


# ---- KITTI's camera -----------------------------------------------------------------------------

TR = np.array([[0.0, -1, 0, 0.1], [0, 0, -1, -0.2], [1, 0, 0, -0.3]])
CAMERA_FROM_LIDAR = Pose3(TR[:, 3], TR[:, :3])


def row(pose: Pose3) -> str:
    matrix = np.hstack([pose.rotation, pose.translation[:, None]])
    return " ".join(repr(float(v)) for v in matrix.ravel()) + "\n"


def drive(step_m: float = 5.0) -> list[Pose3]:
    """Poses of a LIDAR that drives a curve, from the identity on."""
    turn = np.array([[0.995, -0.0998749, 0], [0.0998749, 0.995, 0], [0, 0, 1]])
    step = Pose3(np.array([step_m, 0, 0]), turn)
    poses = [Pose3(np.zeros(3), np.eye(3))]
    for _ in range(5):
        poses.append(poses[-1] @ step)
    return poses


def kitti(folder: Path, poses: list[Pose3], *, calib: bool = True) -> Path:
    """A sequence as it ships: scans below, calibration and poses above."""
    (folder / "velodyne").mkdir(exist_ok=True)
    for i in range(3):
        points = np.array([[4.0, 1.0, -0.5, 0.3]], "<f4")
        (folder / "velodyne" / f"{i:06}.bin").write_bytes(points.tobytes())
    if calib:
        tr = " ".join(repr(float(v)) for v in TR.ravel())
        (folder / "calib.txt").write_text(f"P0: 7 0 6 0 0 7 1 0 0 0 1 0\nTr: {tr}\n")
    (folder / "00.txt").write_text("".join(row(pose) for pose in poses))
    return folder / "velodyne"


def test_poses_of_the_camera_become_those_of_the_lidar(tmp_path: Path) -> None:
    lidar = drive()
    camera = [CAMERA_FROM_LIDAR @ pose @ CAMERA_FROM_LIDAR.inverse() for pose in lidar]
    velodyne = kitti(tmp_path, camera)
    log = open_log(velodyne, poses=tmp_path / "00.txt")
    for scan, pose in zip(log, lidar, strict=False):
        np.testing.assert_allclose(scan.map_from_sensor.translation, pose.translation, atol=1e-9)
        np.testing.assert_allclose(scan.map_from_sensor.rotation, pose.rotation, atol=1e-9)
    assert [note.code for note in log.notes] == ["camera.poses", "pose.by_number"]
    assert "the LIDAR's follow by Tr of calib.txt" in log.notes[0]


def test_poses_of_the_lidar_stay(tmp_path: Path) -> None:
    lidar = drive()
    log = open_log(kitti(tmp_path, lidar), poses=tmp_path / "00.txt")
    assert [s.map_from_sensor.translation.tolist() for s in log] == [
        pose.translation.tolist() for pose in lidar[:3]
    ]
    assert "as the LIDAR's do: Tr of calib.txt is not used" in log.notes[0]


def test_poses_of_either_are_a_question(tmp_path: Path) -> None:
    still = [Pose3(np.zeros(3), np.eye(3))] * 3
    for poses in (drive(0.2), still):
        velodyne = kitti(tmp_path, poses)
        with pytest.raises(InputError, match="say --body-from-sensor '0 0 0 0 0 0 1' if they are"):
            open_log(velodyne, poses=tmp_path / "00.txt")
    (tmp_path / "calib.txt").unlink()
    assert open_log(velodyne, poses=tmp_path / "00.txt").notes == ()
    camera = [CAMERA_FROM_LIDAR @ pose @ CAMERA_FROM_LIDAR.inverse() for pose in drive()[:3]]
    kitti(tmp_path, camera, calib=False)
    log = open_log(velodyne, poses=tmp_path / "00.txt")
    assert "as a camera's do: if they are, say where the LIDAR is" in log.notes[0]
    assert log.notes[0].severity == "warning"
    # What is said by hand is taken as it is said.
    assert (
        open_log(velodyne, poses=tmp_path / "00.txt", body_from_sensor=CAMERA_FROM_LIDAR).notes
        == ()
    )
