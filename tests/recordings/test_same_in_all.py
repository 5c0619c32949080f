# SPDX-License-Identifier: Apache-2.0
"""The same log in each container, and as CARMEN, is the same evidence, bit for bit."""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import BeamSensor, Pose2, Scan, build_map, open_log
from oddsmap.errors import InputError
from oddsmap.recordings.ros_recording import open_ros_recording
from tests.kit import votes_of
from tests.recordings.bags import CONTAINERS, Messages, Said


def carmen_lines(count: int, beams: int) -> list[str]:
    """Scans of a robot that turns, with ranges to the centimetre as CARMEN has them."""
    rng = np.random.default_rng(3)
    lines = []
    for k in range(count):
        ranges = " ".join(f"{each:.2f}" for each in rng.uniform(1.0, 9.0, beams))
        x, y, yaw = 0.11 * k, -0.07 * k, math.remainder(0.3 * k, 2 * math.pi)
        pose = f"{x:.6f} {y:.6f} {yaw:.6f}"
        lines.append(f"FLASER {beams} {ranges} {pose} {pose} {100 + 0.2 * k:.6f} host 0.0")
    return lines


def same_evidence(lines: Iterable[str], folder: Path, resolution: float) -> None:
    """Compare CARMEN with the same scans in each container.

    A LaserScan has ranges and angles of 4 bytes, and a pose is a quaternion. So the scans of CARMEN
    are rounded to these first: ranges to float32, directions to a float32 start and step, the yaw
    through a quaternion. Everything else, and all that is done with it, must be the same.
    """
    log = folder / "a.log"
    log.write_text("\n".join([*lines, ""]))
    scans = list(open_log(log))
    start, step = (float(np.float32(each)) for each in first_and_step(scans[0]))
    angles = start + step * np.arange(scans[0].size)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    assert np.abs(ways - scans[0].directions).max() < 1e-6
    want = [
        Scan(
            through_quaternion(scan.map_from_sensor),
            ways,
            scan.ranges.astype(np.float32).astype(np.float64),
            scan.stamp_ns,
        )
        for scan in scans
    ]
    sensor = BeamSensor(range_max=30.0)
    votes = votes_of(build_map(want, resolution, sensor=sensor))
    for container in CONTAINERS:
        messages = Messages(container)
        said: list[Said] = []
        for scan in scans:
            assert scan.stamp_ns is not None
            pose = scan.map_from_sensor
            at = (*pose.translation.tolist(), 0.0)
            yaw = math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])
            moved = messages.transform(scan.stamp_ns, "map", "laser", at, yaw)
            said.append(("/tf", scan.stamp_ns, messages.tf(moved)))
            laser = messages.laser(scan.stamp_ns, "laser", scan.ranges, start, step)
            said.append(("/scan", scan.stamp_ns, laser))
        found = list(open_log(messages.write(folder / container, said)))
        for one, other in zip(found, want, strict=True):
            assert one.stamp_ns == other.stamp_ns
            np.testing.assert_array_equal(one.ranges, other.ranges)
            np.testing.assert_array_equal(one.directions, other.directions)
            a, b = one.map_from_sensor, other.map_from_sensor
            np.testing.assert_array_equal(a.translation, b.translation)
            np.testing.assert_array_equal(a.rotation, b.rotation)
        assert votes_of(build_map(found, resolution, sensor=sensor)) == votes


def first_and_step(scan: Scan) -> tuple[float, float]:
    angles = np.unwrap(np.arctan2(scan.directions[:, 1], scan.directions[:, 0]))
    return float(angles[0]), float((angles[-1] - angles[0]) / (len(angles) - 1))


def through_quaternion(pose: Any) -> Pose2:
    """A pose as a quaternion gives it back."""
    yaw = math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])
    z, w = math.sin(yaw / 2), math.cos(yaw / 2)
    norm = math.hypot(z, w)
    z, w = z / norm, w / norm
    x, y = pose.translation.tolist()
    return Pose2(x, y, math.atan2(2 * z * w, 1 - 2 * z * z))


def test_carmen_and_each_container_are_one(tmp_path: Path) -> None:
    same_evidence(carmen_lines(25, 90), tmp_path, 0.1)


@pytest.mark.realdata
def test_intel_and_each_container_are_one(data_folder: Path, tmp_path: Path) -> None:
    path = next((data_folder / "laser2d").rglob("intel*.log.gz"))
    with gzip.open(path, "rt") as file:
        lines = [line.rstrip("\n") for line in file if line.startswith("FLASER")][:500]
    same_evidence(lines, tmp_path, 0.05)


@pytest.mark.realdata
def test_all_types_are_the_same_in_sqlite_and_mcap(data_folder: Path) -> None:
    found = []
    for name in ("all_types_sqlite3", "all_types_mcap"):
        recording = open_ros_recording(str(data_folder / "ros" / "ros2" / name))
        messages = list(recording.messages(recording.topics))
        assert len(messages) == 188
        assert len({each.topic for each in messages}) == 94
        found.append(sorted(messages, key=lambda each: (each.topic, each.log_ns)))
        counts = {name: topic.count for name, topic in recording.topics.items()}
        assert set(counts.values()) == {2}
    for one, other in zip(*found, strict=True):
        # They were made anew for each, so that stamps and times of writing are others.
        assert one.topic == other.topic
        assert equal(one.data, other.data), one.topic


def equal(one: Any, other: Any) -> bool:
    """Whether two messages have the same fields with the same bits, stamps aside."""
    if isinstance(one, np.ndarray):
        return bool(one.dtype == other.dtype and one.tobytes() == other.tobytes())
    if isinstance(one, list):
        return len(one) == len(other) and all(map(equal, one, other))
    if hasattr(one, "__dataclass_fields__"):
        names = list(one.__dataclass_fields__)
        return names == list(other.__dataclass_fields__) and all(
            equal(getattr(one, name), getattr(other, name)) for name in names if name != "stamp"
        )
    return bool(one == other or (one != one and other != other))


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "there"),
    [
        ("ros1/no-messages.bag", "it has no messages"),
        ("nav2_turtlebot_tf_only.mcap", "/tf (TFMessage, 5422), /tf_static (TFMessage, 1)"),
        ("ros1/robot_localization_test1.bag", "it has /fix (NavSatFix, 989), "),
        ("ros1/ouster_512x10_raw.bag", "PacketMsg"),
    ],
)
def test_recordings_without_ranges_say_what_they_have(
    name: str, there: str, data_folder: Path
) -> None:
    with pytest.raises(InputError) as caught:
        open_log(data_folder / "ros" / name)
    text = str(caught.value)
    assert "no topic of scans" in text
    assert there in text
    assert "\n" not in text
