# SPDX-License-Identifier: Apache-2.0
"""Traps of frames and stamps, each in a recording of its own."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import Pose3, open_log
from oddsmap.errors import InputError
from tests.recordings.bags import Messages, Said
from tests.recordings.test_recorded_log import SECOND, START, drive


@pytest.fixture
def ros() -> Messages:
    return Messages("bag")


def places(log: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([scan.map_from_sensor.translation for scan in log])


WANT = np.array(
    [(0.05 * k + 0.2 * math.cos(0.02 * k), 0.01 * k + 0.2 * math.sin(0.02 * k)) for k in range(20)]
)


def test_leading_slashes_are_no_part_of_a_name(ros: Messages, tmp_path: Path) -> None:
    said = drive(ros)
    for k, (topic, _, message) in enumerate(said):
        if topic == "/scan" and k % 3 == 0:
            message.header.frame_id = "/laser"
        elif topic != "/scan":
            (moved,) = message.transforms
            moved.child_frame_id = f"/{moved.child_frame_id}"
            moved.header.frame_id = f"/{moved.header.frame_id}"
    log = open_log(ros.write(tmp_path / "run", said), frame="/map")
    np.testing.assert_allclose(places(log), WANT, atol=1e-12)


def test_the_map_as_a_child(ros: Messages, tmp_path: Path) -> None:
    """As where a localiser publishes odom to map: here base to map."""
    said = drive(ros)
    for topic, _, message in said:
        if topic == "/tf":
            (moved,) = message.transforms
            move, yaw = moved.transform.translation, 2 * math.asin(moved.transform.rotation.z)
            x, y, c, s = move.x, move.y, math.cos(yaw), math.sin(yaw)
            at = (-c * x - s * y, s * x - c * y, 0.0)
            stamp = moved.header.stamp.sec * SECOND + moved.header.stamp.nanosec
            message.transforms[:] = [ros.transform(stamp, "base", "map", at, -yaw)]
    log = open_log(ros.write(tmp_path / "run", said))
    np.testing.assert_allclose(places(log), WANT, atol=1e-9)


def test_fixed_transforms_repeated_on_tf(ros: Messages, tmp_path: Path) -> None:
    """They are known before the first and after the last of their stamps, too."""
    said = [each for each in drive(ros) if each[0] != "/tf_static"]
    for k in range(50):
        now = START + SECOND + k * SECOND // 50
        fixed = ros.transform(now, "base", "laser", (0.2, 0.0, 0.3), 0.0)
        said.append(("/tf", now, ros.tf(fixed)))
    log = open_log(ros.write(tmp_path / "run", said))
    np.testing.assert_allclose(places(log), WANT, atol=1e-12)
    assert log.skipped == {}


def test_headers_ahead_of_the_time_of_writing(ros: Messages, tmp_path: Path) -> None:
    log = open_log(ros.write(tmp_path / "run", drive(ros, log_late=-7_600_000_000)))
    np.testing.assert_allclose(places(log), WANT, atol=1e-12)


def notes_of(ros: Messages, said: list[Said], tmp_path: Path) -> list[str]:
    return [str(note) for note in open_log(ros.write(tmp_path / "run", said)).notes]


def test_one_stamp_with_two_values_is_told(ros: Messages, tmp_path: Path) -> None:
    said = drive(ros)
    for k in range(3):
        other = ros.transform(START + k * SECOND // 10, "map", "base", (9.0, 0.0, 0.0), 0.0)
        said.append(("/tf", START + 2 * SECOND, ros.tf(other)))
    path = ros.write(tmp_path / "run", said)
    log = open_log(path)
    np.testing.assert_allclose(places(log), WANT, atol=1e-12)
    (note,) = log.notes
    assert note.severity == "warning"
    assert (
        note == "3 transforms map to base differ from another of the same stamp: the first of "
        "each counts"
    )


def test_a_fixed_transform_with_two_values_is_told(ros: Messages, tmp_path: Path) -> None:
    said = drive(ros)
    other = ros.transform(START, "base", "laser", (0.7, 0.0, 0.3), 0.0)
    said.insert(1, ("/tf_static", START, ros.tf(other)))
    (note,) = notes_of(ros, said, tmp_path)
    assert note == "base to laser is stated 2 times as fixed, and differently: the last counts"


def test_a_transform_that_is_fixed_and_moves_is_told(ros: Messages, tmp_path: Path) -> None:
    said = drive(ros)
    for k in range(3):
        now = START + k * SECOND
        other = ros.transform(now, "base", "laser", (0.1 * k, 0.0, 0.3), 0.0)
        said.append(("/tf", now, ros.tf(other)))
    (note,) = notes_of(ros, said, tmp_path)
    assert note == "base to laser is stated as fixed, and moves elsewhere: the fixed one counts"


def test_scans_that_lean_between_glances_are_told(ros: Messages, tmp_path: Path) -> None:
    """Every other scan is looked at before the map is known to be flat."""
    said: list[Said] = []
    for k in range(100):
        now = START + k * SECOND // 10
        moved = ros.transform(now, "map", "laser", (0.01 * k, 0.0, 0.0), 0.0)
        lean = math.radians(5.0) if k == 31 else 0.0
        turn = moved.transform.rotation
        turn.x, turn.w = math.sin(lean / 2), math.cos(lean / 2)
        said.append(("/tf", now, ros.tf(moved)))
        said.append(("/scan", now, ros.laser(now, "laser", np.full(8, 2.0))))
    log = open_log(ros.write(tmp_path / "run", said))
    assert len(list(log)) == 100
    (note,) = log.notes
    assert (
        note == "1 scans lean by more than 3 degrees, up to 5: they are mapped as if they were "
        "level"
    )


def in_the_map(ros: Messages, frame: str, *, transforms: bool) -> list[Said]:
    """Points of a wall in the frame of a map, seen by a robot that drives along it."""
    said: list[Said] = []
    points = np.zeros(2, [("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    points["x"], points["y"] = [3.0, 4.0], [1.0, 2.0]
    for k in range(5):
        now = START + k * SECOND // 10
        if transforms:
            drift = ros.transform(now, "map", "odom", (0.01 * k, 0.0, 0.0), 0.0)
            moved = ros.transform(now, "odom", "base_link", (0.5 * k, 0.0, 0.0), 0.3)
            said.append(("/tf", now, ros.tf(drift, moved)))
        here = ros.odometry(now, "odom", "base_link", (0.5 * k, 0.0, 0.0), 0.3)
        said.append(("/odom", now, here))
        said.append(("/points", now, ros.cloud(now, frame, points)))
    return said


def test_points_in_the_frame_of_the_poses_are_seen_from_them(ros: Messages, tmp_path: Path) -> None:
    """Also where transforms lead from that frame to the body."""
    log = open_log(ros.write(tmp_path / "run", in_the_map(ros, "odom", transforms=True)))
    assert [note.code for note in log.notes] == ["pose.topic", "cloud.in_map"]
    for k, scan in enumerate(log):
        ends = scan.map_from_sensor.transform(scan.directions * scan.ranges[:, None])
        np.testing.assert_allclose(ends, [[3.0, 1.0, 0.0], [4.0, 2.0, 0.0]], atol=1e-6)
        np.testing.assert_allclose(scan.map_from_sensor.translation, [0.5 * k, 0.0, 0.0])


def test_points_in_another_map_than_the_poses_are_refused(ros: Messages, tmp_path: Path) -> None:
    path = ros.write(tmp_path / "run", in_the_map(ros, "map", transforms=True))
    with pytest.raises(InputError, match=r"the scans are in the frame map, .* give poses in map"):
        open_log(path)
    with pytest.raises(InputError, match="the scans are in the frame map, that of a map, and tran"):
        open_log(path, poses="tf")


def test_points_in_the_map_with_poses_of_a_file(ros: Messages, tmp_path: Path) -> None:
    path = ros.write(tmp_path / "run", in_the_map(ros, "map", transforms=False))
    poses = tmp_path / "poses.txt"
    poses.write_text(f"{START // SECOND - 1} 1 0 0 0 0 0 1\n{START // SECOND + 9} 1 0 0 0 0 0 1\n")
    log = open_log(path, poses=poses, tolerance_s=10)
    assert [note.code for note in log.notes] == ["cloud.in_map"]
    for scan in log:
        ends = scan.map_from_sensor.transform(scan.directions * scan.ranges[:, None])
        np.testing.assert_allclose(ends, [[3.0, 1.0, 0.0], [4.0, 2.0, 0.0]], atol=1e-6)
        assert scan.map_from_sensor.translation.tolist() == [1.0, 0.0, 0.0]


def test_a_laser_cannot_be_in_the_frame_of_the_map(ros: Messages, tmp_path: Path) -> None:
    said = in_the_map(ros, "odom", transforms=False)
    for k, (topic, now, message) in enumerate(said):
        if topic == "/points":
            said[k] = ("/scan", now, ros.laser(now, message.header.frame_id, [2.0, 3.0]))
    log = open_log(ros.write(tmp_path / "run", said))
    assert [note.code for note in log.notes] == ["pose.topic", "laser.in_map"]
    assert [scan.map_from_sensor.translation[0] for scan in log] == [0.0, 0.5, 1.0, 1.5, 2.0]


def test_poses_of_a_file_beside_transforms_that_place_the_sensor(
    ros: Messages, tmp_path: Path
) -> None:
    said = drive(ros)
    said[0][2].transforms[0].header.frame_id = "base_link"
    poses = tmp_path / "poses.txt"
    poses.write_text(f"{START // SECOND - 1} 1 0 0 0 0 0 1\n{START // SECOND + 9} 1 0 0 0 0 0 1\n")
    path = ros.write(tmp_path / "run", said)
    (note,) = open_log(path, poses=poses, tolerance_s=10).notes
    assert note.severity == "warning"
    assert "if they are those of base_link, say --body-from-sensor '0.2 0 0.3 0 0 0 1'" in note
    mounted = Pose3(np.array([0.2, 0.0, 0.3]), np.eye(3))
    assert open_log(path, poses=poses, tolerance_s=10, body_from_sensor=mounted).notes == ()


def test_an_extrinsic_beside_transforms_is_refused(ros: Messages, tmp_path: Path) -> None:
    path = ros.write(tmp_path / "run", drive(ros))
    with pytest.raises(InputError, match="the transforms say where 'laser' sits: leave `body_from"):
        open_log(path, body_from_sensor=Pose3(np.zeros(3), np.eye(3)))


def test_poses_of_a_file_for_several_sensors_are_those_of_the_body(
    ros: Messages, tmp_path: Path
) -> None:
    said = drive(ros)
    said[0][2].transforms[0].header.frame_id = "base_link"
    rear = ros.transform(START, "base_link", "rear", (-0.2, 0.0, 0.3), math.pi)
    for k in range(3):
        now = START + k * SECOND // 10
        said.append(("/rear", now, ros.laser(now, "rear", [2.0, 3.0])))
    poses = tmp_path / "poses.txt"
    poses.write_text(f"{START // SECOND - 1} 1 0 0 0 0 0 1\n{START // SECOND + 9} 1 0 0 0 0 0 1\n")
    path = ros.write(tmp_path / "run", said)
    how: dict[str, Any] = {"poses": poses, "tolerance_s": 10, "scans": ["/scan", "/rear"]}
    with pytest.raises(InputError, match="scans in the frames laser and rear, poses of one, an"):
        open_log(path, **how)
    said.insert(1, ("/tf_static", START, ros.tf(rear)))
    log = open_log(ros.write(tmp_path / "more", said), **how)
    assert [str(note) for note in log.notes] == ["the poses are taken as those of base_link"]
    xs = {scan.sensor_id: scan.map_from_sensor.translation[0] for scan in log}
    assert xs == {"/scan": pytest.approx(1.2), "/rear": pytest.approx(0.8)}
    mounted = Pose3(np.zeros(3), np.eye(3))
    with pytest.raises(InputError, match="one `body_from_sensor`, and scans in the frames la"):
        open_log(path, body_from_sensor=mounted, **how)


def test_a_topic_of_poses_that_does_not_name_its_body(ros: Messages, tmp_path: Path) -> None:
    said = [each for each in drive(ros) if each[0] != "/tf"]
    said[0][2].transforms[0].header.frame_id = "base_link"
    for k in range(20):
        now = START + k * SECOND // 10
        said.append(("/pose", now, ros.odometry(now, "map", "", (0.1 * k, 0.0, 0.0), 0.0)))
    path = ros.write(tmp_path / "run", said)
    note = open_log(path).notes[-1]
    assert note.code == "extrinsics.missing"
    assert note.endswith(
        "('0.2 0 0.3 0 0 0 1', as transforms put it, if the poses are those of base_link)"
    )
    with pytest.raises(InputError, match="the poses are given, and in one frame: leave `frame` ou"):
        open_log(path, poses="/pose", frame="map")
