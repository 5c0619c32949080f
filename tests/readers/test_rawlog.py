# SPDX-License-Identifier: Apache-2.0
"""MRPT rawlogs: laser scans from where odometry, or a trajectory, puts the robot."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import open_log
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose2, Pose3
from tests.readers.rawlogs import odometry, rawlog, scan

RANGES = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
FAN = np.linspace(-np.pi / 2, np.pi / 2, 5)
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # a quarter to the left
AT_HOME = odometry(0.0, 2.0, 3.0, np.pi / 2)


def log_of(folder: Path, *objects: bytes, **options: Any) -> Any:
    path = folder / "a.rawlog"
    path.write_bytes(b"".join(objects))
    return open_log(path, **options)


def test_scans_between_two_readings_of_the_odometry(tmp_path: Path) -> None:
    for content in (rawlog(), gzip.compress(rawlog())):
        log = log_of(tmp_path, content)
        assert log.format == "MRPT rawlog"
        assert log.sensor == {"range_max": 20.0}
        assert "poses are odometry, which drifts" in log.notes[0]
        assert log.skipped == {}
        places = [scan.map_from_sensor.translation.tolist() for scan in log]
        np.testing.assert_allclose(places, [[0.05 + 0.1 * i, 0.0] for i in range(4)])
        for each in log:
            assert each.ranges.tolist() == RANGES.tolist()
            expected = np.stack([np.cos(FAN), np.sin(FAN)], axis=1)
            np.testing.assert_allclose(each.directions, expected, atol=1e-6)


@pytest.mark.parametrize("pose_version", [2, 3])
def test_the_place_of_the_laser(tmp_path: Path, pose_version: int) -> None:
    mount = Pose3(np.array([0.5, 0.0, 0.3]), TURN)
    (seen,) = log_of(tmp_path, AT_HOME, scan(0.0, RANGES, mount=mount, pose_version=pose_version))
    assert isinstance(seen.map_from_sensor, Pose2)
    np.testing.assert_allclose(seen.map_from_sensor.translation, [2.0, 3.5])
    assert abs(seen.map_from_sensor.theta) == pytest.approx(np.pi)


def test_upside_down_and_left_to_right(tmp_path: Path) -> None:
    """Each mirrors the fan; both together leave it."""
    over = np.diag([1.0, -1.0, -1.0])
    for rotation, right_to_left, sign in (
        (np.eye(3), False, -1), (over, True, -1), (over, False, 1)
    ):  # fmt: skip
        mount = Pose3(np.zeros(3), rotation)
        home = odometry(0.0, 0, 0, 0)
        (seen,) = log_of(
            tmp_path, home, scan(0.0, RANGES, mount=mount, right_to_left=right_to_left)
        )
        np.testing.assert_allclose(seen.directions[:, 1], sign * np.sin(FAN), atol=1e-6)


def test_a_laser_that_leans_maps_in_3d(tmp_path: Path) -> None:
    down = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # x of the laser looks down
    log = log_of(tmp_path, AT_HOME, scan(0.0, RANGES, mount=Pose3(np.zeros(3), down)))
    (seen,) = log
    ahead = seen.directions[2]
    np.testing.assert_allclose(seen.map_from_sensor.rotation @ ahead, [0, 0, -1], atol=1e-9)
    assert any("the laser leans" in note for note in log.notes)


def test_readings_that_say_nothing(tmp_path: Path) -> None:
    """Invalid ones below the end of the range; at its end they are no returns."""
    ranges, valid = np.array([1.0, 2.0, 20.0, 20.0, 5.0]), np.array([1, 0, 0, 1, 1])
    (seen,) = log_of(tmp_path, AT_HOME, scan(0.0, ranges, valid, intensity=True))
    np.testing.assert_array_equal(seen.ranges, [1.0, np.nan, 20.0, 20.0, 5.0])


@pytest.mark.parametrize("version", [0, 1, 2])
def test_versions_of_odometry(tmp_path: Path, version: int) -> None:
    home = odometry(0.0, 2.0, 3.0, 0.5, version)
    (seen,) = log_of(tmp_path, home, scan(0.0, RANGES, version=6), home)
    np.testing.assert_allclose(seen.map_from_sensor.translation, [2, 3])
    assert seen.map_from_sensor.theta == pytest.approx(0.5)


def test_poses_of_a_file_and_scans_without_one(tmp_path: Path) -> None:
    poses = tmp_path / "p.csv"
    poses.write_text("t,x,y,theta\n0,7,8,0\n0.2,7,9,0\n")
    log = log_of(tmp_path, rawlog(), poses=poses, tolerance_s=0.2)
    assert [each.map_from_sensor.translation[1] for each in log] == [8.25, 8.75, 9, 9]
    assert not any("odometry" in note for note in log.notes)
    log = log_of(tmp_path, rawlog(), poses=poses)
    assert len(log) == 3
    assert log.skipped == {"scan.no_pose": 1}
    assert "1 scan was skipped:" in log.notes[-1]


def test_what_is_not_known_is_named(tmp_path: Path) -> None:
    other = bytes([0x80 | 28]) + b"mrpt::obs::CActionCollection" + b"\x00"
    cases = [
        ((other,), r"byte 0: an object CActionCollection of version 0, which is not read"),
        ((AT_HOME, other), r"byte \d+: an object CActionCollection"),
        ((scan(0.0, RANGES).replace(b"Scan\x07", b"Scan\x09"),), "CObservation2DRangeScan of ver"),
        ((scan(0.0, RANGES, pitch=0.2),), r"a laser that turned by 0\.2 rad about its y axis"),
        ((AT_HOME,), "no laser scan"),
        ((scan(0.0, RANGES),), "no odometry with a time .* --poses FILE"),
        ((AT_HOME, scan(9.0, RANGES)), "no scan has a pose: .* the nearest is 9 s away"),
        ((AT_HOME, b"hello"), r"byte \d+: no object of MRPT starts here"),
        ((AT_HOME[:-1] + b"\x00", AT_HOME), "CObservationOdometry does not end where it should"),
        ((odometry(0.0, np.nan, 0, 0),), "a pose that is not finite"),
        ((scan(0.0, RANGES, range_max=0.0),), "a laser of 3.14159 rad and 0 m"),
    ]
    for objects, message in cases:
        with pytest.raises(InputError, match=message) as caught:
            log_of(tmp_path, *objects)
        assert "\n" not in str(caught.value)
    for name in ("times", "body_from_sensor", "columns", "origin"):
        values = {"columns": "x,y,z", "body_from_sensor": Pose3(np.zeros(3), np.eye(3))}
        value = values.get(name, (0, 0, 0) if name == "origin" else tmp_path)
        with pytest.raises(InputError, match=f"leave `{name}` out"):
            log_of(tmp_path, rawlog(), **{name: value})


def test_a_file_cut_short(tmp_path: Path) -> None:
    whole = rawlog()
    for end in (len(whole) - 1, len(whole) - 200, 150):
        with pytest.raises(InputError, match="it ends within the object at byte"):
            log_of(tmp_path, whole[:end])
    log = log_of(tmp_path, whole[:-200], skip_bad=True)
    assert len(log) == 3
    assert log.skipped == {"container.truncated": 1}
    log = log_of(tmp_path, gzip.compress(whole, mtime=0)[:-30], skip_bad=True)
    assert log.skipped == {"container.truncated": 1}


@pytest.mark.realdata
def test_driving_in_an_office(data_folder: Path) -> None:
    log = open_log(data_folder / "rawlog" / "mrpt_driving_in_office_obs.rawlog")
    scans = list(log)
    assert len(scans) == 1159
    assert {each.size for each in scans} == {626}
    assert log.sensor == {"range_max": 25.0}
    assert log.skipped == {}
