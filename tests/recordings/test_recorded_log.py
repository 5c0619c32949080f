# SPDX-License-Identifier: Apache-2.0
"""Recordings in each container, from file to evidence."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from oddsmap import BeamSensor, Pose2, Scan, build_map, open_log
from oddsmap.errors import InputError
from tests.kit import votes_of
from tests.recordings.bags import CONTAINERS, Messages, Said

SECOND = 10**9
START = 1_700_000_000 * SECOND


@pytest.fixture(params=CONTAINERS)
def messages(request: pytest.FixtureRequest) -> Messages:
    return Messages(request.param)


def drive(messages: Messages, *, log_late: int = 0, top: str = "map") -> list[Said]:
    """A robot that drives a curve, its laser 0.2 m ahead of its middle; 20 scans."""
    rng = np.random.default_rng(0)
    fixed = messages.transform(START, "base", "laser", (0.2, 0.0, 0.3), 0.0)
    said: list[Said] = [("/tf_static", START, messages.tf(fixed))]
    for k in range(20):
        now = START + k * SECOND // 10
        moved = messages.transform(now, top, "base", (0.05 * k, 0.01 * k, 0.0), 0.02 * k)
        said.append(("/tf", now + log_late, messages.tf(moved)))
        ranges = rng.uniform(3.0, 5.0, 60)
        said.append(("/scan", now + log_late, messages.laser(now, "laser", ranges)))
    return said


def scans_of_the_drive() -> list[Scan]:
    """The same, without a recording."""
    rng = np.random.default_rng(0)
    angles = np.float64(np.float32(0.1)) * np.arange(60)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    scans = []
    for k in range(20):
        yaw = 0.02 * k
        x, y = 0.05 * k + 0.2 * math.cos(yaw), 0.01 * k + 0.2 * math.sin(yaw)
        ranges = rng.uniform(3.0, 5.0, 60).astype(np.float32).astype(np.float64)
        scans.append(Scan(Pose2(x, y, yaw), ways, ranges, START + k * SECOND // 10))
    return scans


def test_from_file_to_evidence(messages: Messages, tmp_path: Path) -> None:
    log = open_log(messages.write(tmp_path / "run", drive(messages)))
    assert len(log) == 20
    assert dict(log.sensor) == {"range_min": 0.1, "range_max": 30.0}
    scans, want = list(log), scans_of_the_drive()
    for scan, same in zip(scans, want, strict=True):
        assert (scan.stamp_ns, scan.sensor_id) == (same.stamp_ns, "/scan")
        assert isinstance(scan.map_from_sensor, Pose2)
        np.testing.assert_allclose(
            scan.map_from_sensor.translation, same.map_from_sensor.translation, atol=1e-12
        )
        np.testing.assert_array_equal(scan.ranges, same.ranges)
        np.testing.assert_array_equal(scan.directions, same.directions)
    sensor = BeamSensor(range_max=30.0)
    got = build_map(scans, 0.1, sensor=sensor)
    assert votes_of(got) == votes_of(build_map(want, 0.1, sensor=sensor))


def test_the_stamps_of_headers_count_not_the_time_of_writing(
    messages: Messages, tmp_path: Path
) -> None:
    log = open_log(messages.write(tmp_path / "run", drive(messages, log_late=8 * SECOND)))
    assert [scan.stamp_ns for scan in log] == [START + k * SECOND // 10 for k in range(20)]


def test_a_clock_offset_is_added_to_scans(messages: Messages, tmp_path: Path) -> None:
    path = messages.write(tmp_path / "run", drive(messages))
    log = open_log(path, clock_offset_s=0.1)
    scans = list(log)
    assert log.skipped == {"scan.no_pose": 1}
    x = scans[0].map_from_sensor.translation[0]
    assert x == pytest.approx(0.05 + 0.2 * math.cos(0.02))


def test_scans_before_the_first_pose_are_counted(messages: Messages, tmp_path: Path) -> None:
    said, early = drive(messages), START - SECOND // 20
    said.insert(0, ("/scan", early, messages.laser(early, "laser", np.full(60, 4.0))))
    log = open_log(messages.write(tmp_path / "run", said))
    assert len(list(log)) == 20
    assert log.skipped == {"scan.no_pose": 1}
    assert "1 scan was skipped: /scan: " in log.notes[-1]


def test_the_map_is_odometry_and_says_so(messages: Messages, tmp_path: Path) -> None:
    log = open_log(messages.write(tmp_path / "run", drive(messages, top="odom")))
    assert [note.code for note in log.notes] == ["pose.odometry"]
    assert len(list(log)) == 20


def test_odometry_without_transforms(messages: Messages, tmp_path: Path) -> None:
    said: list[Said] = []
    for k in range(5):
        now = START + k * SECOND // 10
        here = messages.odometry(now, "odom", "base", (0.1 * k, 0.0, 0.0), 0.0)
        said.append(("/odom", now, here))
        said.append(("/scan", now, messages.laser(now, "laser", np.full(10, 2.0))))
    log = open_log(messages.write(tmp_path / "run", said))
    codes = [note.code for note in log.notes]
    assert codes == ["pose.topic", "extrinsics.missing"]
    xs = [scan.map_from_sensor.translation[0] for scan in log]
    assert xs == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])


def test_poses_of_a_file(messages: Messages, tmp_path: Path) -> None:
    said = [each for each in drive(messages) if each[0] == "/scan"]
    path = messages.write(tmp_path / "run", said)
    with pytest.raises(InputError, match="no topic has poses: give poses with --poses"):
        open_log(path)
    poses = tmp_path / "poses.txt"
    stamps = [START // SECOND + k for k in range(-1, 4)]
    poses.write_text("".join(f"{stamp}.0 {k - 1} 0 0 0 0 0 1\n" for k, stamp in enumerate(stamps)))
    xs = [
        scan.map_from_sensor.translation[0] for scan in open_log(path, poses=poses, tolerance_s=1)
    ]
    assert xs == pytest.approx([0.1 * k for k in range(20)])


def test_a_laser_that_leans_maps_in_space(messages: Messages, tmp_path: Path) -> None:
    said: list[Said] = []
    for k in range(5):
        now = START + k * SECOND // 10
        moved = messages.transform(now, "map", "laser", (0.0, 0.0, 1.0), 0.0)
        turned = moved.transform.rotation
        turned.x, turned.w = math.sin(0.1 * k), math.cos(0.1 * k)
        said.append(("/tf", now, messages.tf(moved)))
        said.append(("/scan", now, messages.laser(now, "laser", np.full(20, 2.0))))
    log = open_log(messages.write(tmp_path / "run", said))
    assert "laser.leans" in [note.code for note in log.notes]
    grid = build_map(log, 0.1, sensor=BeamSensor(range_max=30.0))
    assert grid.ndim == 3
    bounds = grid.bounds()
    assert bounds is not None
    assert bounds[1][2] == 10 + round(20 * math.sin(0.8)) + 1


def test_a_laser_upside_down_scans_the_other_way(tmp_path: Path) -> None:
    messages = Messages("bag")
    said: list[Said] = []
    for k in range(3):
        now = START + k * SECOND // 10
        moved = messages.transform(now, "map", "laser", (0.1 * k, 0.0, 1.0), 0.0)
        moved.transform.rotation.x, moved.transform.rotation.w = 1.0, 0.0  # around its x axis
        said.append(("/tf", now, messages.tf(moved)))
        readings = messages.laser(now, "laser", np.full(2, 2.0), 0.0, math.pi / 2)
        said.append(("/scan", now, readings))
    for scan in open_log(messages.write(tmp_path / "run", said)):
        np.testing.assert_allclose(scan.directions, [[1.0, 0.0], [0.0, -1.0]], atol=1e-6)


def test_clouds_in_the_frame_of_the_map(messages: Messages, tmp_path: Path) -> None:
    said: list[Said] = []
    points = np.zeros(2, [("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    points["x"], points["y"] = [3.0, 4.0], [1.0, 2.0]
    for k in range(3):
        now = START + k * SECOND // 10
        here = messages.odometry(now, "/map", "base", (0.5 * k, 0.0, 0.0), 0.3)
        said.append(("/odom", now, here))
        said.append(("/points", now, messages.cloud(now, "/map", points)))
    log = open_log(messages.write(tmp_path / "run", said))
    assert "cloud.in_map" in [note.code for note in log.notes]
    for k, scan in enumerate(log):
        ends = scan.map_from_sensor.transform(scan.directions * scan.ranges[:, None])
        np.testing.assert_allclose(ends, [[3.0, 1.0, 0.0], [4.0, 2.0, 0.0]], atol=1e-9)
        np.testing.assert_allclose(scan.map_from_sensor.translation, [0.5 * k, 0.0, 0.0])


def test_several_topics_are_asked_about(messages: Messages, tmp_path: Path) -> None:
    said = drive(messages)
    said.append(("/rear", START, messages.laser(START, "laser", np.full(60, 4.0))))
    path = messages.write(tmp_path / "run", said)
    with pytest.raises(InputError, match=r"/rear \(LaserScan, 1\), /scan \(LaserScan, 20\): say w"):
        open_log(path)
    assert len(open_log(path, scans="/scan")) == 20
    assert len(open_log(path, scans=["/scan", "/rear"])) == 21
    with pytest.raises(InputError, match="/front is no topic of scans: it has /rear"):
        open_log(path, scans="/front")


def test_several_frames_are_asked_about(messages: Messages, tmp_path: Path) -> None:
    said = drive(messages, top="odom")
    for k in range(20):
        now = START + k * SECOND // 10
        moved = messages.transform(now, "base", "map_truth", (-0.04 * k, 0.0, 0.0), 0.0)
        said.append(("/tf", now, messages.tf(moved)))
    path = messages.write(tmp_path / "run", said)
    with pytest.raises(InputError, match="could be in map_truth or odom: say which with --frame"):
        open_log(path)
    log = open_log(path, frame="map_truth")
    assert next(iter(log)).map_from_sensor.translation[0] == pytest.approx(0.2)


def test_nothing_to_map_says_what_is_there(messages: Messages, tmp_path: Path) -> None:
    said = [each for each in drive(messages) if each[0] != "/scan"]
    path = messages.write(tmp_path / "run", said)
    with pytest.raises(InputError, match=r"no topic of scans .* it has /tf \(TFMessage, 20\), "):
        open_log(path)


def test_options_of_recordings_are_refused_elsewhere(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text("FLASER 1 2.0 0 0 0 0 0 0 1.0 host 1.0\n")
    with pytest.raises(InputError, match="this log has no topics: leave `scans` out"):
        open_log(path, scans="/scan")


@pytest.mark.parametrize("cut", [20, 1000, 3000, 8000])
def test_a_recording_that_is_cut_off_is_one_line(
    messages: Messages, cut: int, tmp_path: Path
) -> None:
    path = messages.write(tmp_path / "run", drive(messages))
    file = path if path.is_file() else next(path.glob("run*"))
    file.write_bytes(file.read_bytes()[:cut])
    with pytest.raises(InputError) as caught:
        list(open_log(path))
    assert "\n" not in str(caught.value)
