# SPDX-License-Identifier: Apache-2.0
"""Messages of sensors: lasers, and clouds of any fields with times in any unit."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap.errors import InputError
from oddsmap.recordings.scan_messages import beams_of
from tests.recordings.bags import Messages

STAMP = 1_700_000_000_123_456_789
XYZ = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
CLOUD, LASER = "sensor_msgs/PointCloud2", "sensor_msgs/LaserScan"


@pytest.fixture
def ros() -> Messages:
    return Messages("mcap")


def table(fields: list[tuple[str, str]], count: int = 6) -> npt.NDArray[np.void]:
    points = np.zeros(count, fields)
    points["x"] = np.arange(count)
    points["z"] = -1.5
    return points


def test_points_among_other_fields_in_any_order(ros: Messages) -> None:
    fields = [("ring", "<u2"), ("z", "<f8"), ("y", "<f4"), ("intensity", "<f4"), ("x", "<f4")]
    beams = beams_of(CLOUD, ros.cloud(STAMP, "/lidar", table(fields)))
    assert beams.frame == "lidar"
    assert beams.stamp_ns == STAMP
    assert beams.after_ns is None
    assert beams.points is not None
    np.testing.assert_array_equal(beams.points[:, 0], np.arange(6))
    np.testing.assert_array_equal(beams.points[:, 2], np.full(6, -1.5))


def test_an_organised_cloud(ros: Messages) -> None:
    beams = beams_of(CLOUD, ros.cloud(STAMP, "lidar", table(XYZ), rows=2))
    assert beams.points is not None
    np.testing.assert_array_equal(beams.points[:, 0], np.arange(6))


AFTER = np.array([0, 20, 40, 60, 80, 99]) * 1_000_000
TIMES = [
    ("t", "<u4", AFTER),
    ("offset_time", "<u4", AFTER),
    ("time", "<f4", AFTER / 1e9),
    ("time", "<f4", AFTER / 1e6),
    ("t", "<u4", AFTER // 1000),
    ("timestamp", "<f8", (STAMP + AFTER) / 1e9),
    ("timestamp", "<f8", (STAMP + AFTER).astype(np.float64)),
]


@pytest.mark.parametrize(("name", "kind", "values"), TIMES)
def test_times_in_any_unit(
    name: str, kind: str, values: npt.NDArray[np.float64], ros: Messages
) -> None:
    points = table([*XYZ, (name, kind)])
    points[name] = values
    after = beams_of(CLOUD, ros.cloud(STAMP, "lidar", points)).after_ns
    assert after is not None
    # Nanoseconds since 1970 in a double are 256 ns coarse; so are seconds.
    np.testing.assert_allclose(after, AFTER, atol=300)


@pytest.mark.parametrize(
    ("name", "kind", "values"),
    [("time", "<f4", np.zeros(6)), ("t", "<u4", np.arange(6)), ("t", "<f4", np.full(6, np.nan))],
)
def test_what_is_no_time(
    name: str, kind: str, values: npt.NDArray[np.float64], ros: Messages
) -> None:
    points = table([*XYZ, (name, kind)])
    points[name] = values
    assert beams_of(CLOUD, ros.cloud(STAMP, "lidar", points)).after_ns is None


def test_a_cloud_without_z(ros: Messages) -> None:
    points = np.zeros(3, XYZ[:2])
    with pytest.raises(InputError, match="a cloud without z: its fields are x, y"):
        beams_of(CLOUD, ros.cloud(STAMP, "lidar", points))


@pytest.mark.parametrize(("name", "value"), [("width", 10**9), ("point_step", 4), ("height", 99)])
def test_a_cloud_that_contradicts_itself(name: str, value: int, ros: Messages) -> None:
    cloud = ros.cloud(STAMP, "lidar", table(XYZ))
    setattr(cloud, name, value)
    with pytest.raises(InputError, match="a cloud "):
        beams_of(CLOUD, cloud)


def test_a_laser_says_its_limits_as_people_wrote_them(ros: Messages) -> None:
    beams = beams_of(LASER, ros.laser(STAMP, "laser", [1.0, np.inf, np.nan], every=1e-4))
    assert dict(beams.settings) == {"range_min": 0.1, "range_max": 30.0}
    assert beams.after_ns is not None
    np.testing.assert_allclose(beams.after_ns, [0, 100_000, 200_000], atol=10)
    np.testing.assert_array_equal(beams.ranges, [1.0, np.inf, np.nan])
    np.testing.assert_allclose(np.linalg.norm(beams.directions, axis=1), 1.0)


def test_a_laser_whose_angles_are_no_numbers(ros: Messages) -> None:
    message = ros.laser(STAMP, "laser", [1.0, 2.0])
    message.angle_min = float("nan")
    with pytest.raises(InputError, match="a laser of 2 beams from nan"):
        beams_of(LASER, message)


@pytest.mark.parametrize(("count", "doubted"), [(10, False), (11, False), (20, True), (5, True)])
def test_a_laser_of_another_number_of_beams_than_its_angles(
    count: int, doubted: bool, ros: Messages
) -> None:
    message = ros.laser(STAMP, "laser", np.ones(count))
    message.angle_max = 1.0
    notes = beams_of(LASER, message).notes
    assert [note.code for note in notes] == ["laser.angles"] * doubted
    if count == 20:
        assert notes[0].startswith("a scan has 20 beams, and 11 by its angles: they are taken in ")
