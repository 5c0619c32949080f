# SPDX-License-Identifier: Apache-2.0
"""What keeps a 2D reading from marking, or from counting: the body's box and the angle window."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from typing import Any

import numpy as np
import pytest

from oddsmap import BeamSensor, ConeSensor, Pose2, Scan, build_full_map, build_map
from oddsmap.errors import ConfigError
from oddsmap.evidence_map import EvidenceMap
from oddsmap.integrate.add import add_scans
from oddsmap.poses.pose import Pose3
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.sensors.filters import beams_within
from oddsmap.sensors.usable_beams import usable_beams
from tests.kit import votes_of

BOX: dict[str, Any] = {"body_min": (-0.3, -0.2), "body_max": (0.5, 0.2)}


def fan(degrees: list[float], ranges: list[float], theta: float = 0.0, **more: Any) -> Scan:
    angles = np.radians(degrees)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return Scan(Pose2(0.05, 0.05, theta), directions, np.array(ranges), **more)


def counts(scans: list[Scan], sensor: Any) -> tuple[int, Counter[str]]:
    report = build_map(scans, 0.1, sensor=sensor).report
    assert report is not None
    return report.beams, report.skipped


@pytest.mark.parametrize("theta", [0.0, 2.0])
def test_a_return_on_the_body_clears_and_does_not_mark(theta: float) -> None:
    """Of the box's sides each is met once and just missed once, whichever way the robot looks."""
    scan = fan([0, 0, 180, 180, 90, 90], [0.5, 0.51, 0.3, 0.31, 0.2, 0.21], theta)
    kept = Scan(scan.map_from_sensor, scan.directions[1::2], scan.ranges[1::2])
    assert counts([scan], BeamSensor(**BOX)) == (6, {"hit.on_body": 3})
    hits = {c: v for c, v in votes_of(build_map([scan], 0.1, sensor=BeamSensor(**BOX))).items()
            if v[0]}  # fmt: skip
    assert hits == {c: v for c, v in votes_of(build_map([kept], 0.1)).items() if v[0]}
    assert sum(hit for hit, _ in hits.values()) == 3 * 65536


def test_the_body_is_where_the_sensor_sees_it_from_where_a_beam_starts() -> None:
    scan = fan([0, 0], [0.4, 0.4], beam_origins=np.array([[0.0, 0.0], [0.2, 0.0]]))
    assert counts([scan], BeamSensor(**BOX)) == (2, {"hit.on_body": 1})


def test_a_cone_on_the_body() -> None:
    """By where its axis ends; of the box's sides each is met once and just missed once."""
    scan = fan([0, 0, 180, 180, 90, 90, -90, -90], [0.5, 0.51, 0.3, 0.31, 0.2, 0.21, 0.2, 0.21])
    cone = ConeSensor(cone_deg=20.0, **BOX)
    assert counts([scan], cone) == (8, {"hit.on_body": 4})
    votes = build_map([scan], 0.1, sensor=cone)
    assert sum(hit for hit, _ in votes_of(votes).values()) == pytest.approx(4 * 65536, abs=8)


@pytest.mark.parametrize("sensor", [BeamSensor(), ConeSensor(cone_deg=20.0)])
def test_a_body_in_space_has_six_sides(sensor: BeamSensor | ConeSensor) -> None:
    low, high = (-0.3, -0.2, -0.4), (0.5, 0.25, 0.6)
    axes = np.repeat(np.concatenate([np.eye(3), -np.eye(3)]), 2, axis=0)
    sides = np.repeat([*high, *(-x for x in low)], 2)
    scan = Scan(Pose3(np.full(3, 0.05), np.eye(3)), axes, sides + np.tile([0.0, 0.01], 6))
    boxed = dataclasses.replace(sensor, body_min=low, body_max=high)
    assert counts([scan], boxed) == (12, {"hit.on_body": 6})


WINDOWS = [
    ((-math.pi / 2, math.pi / 2), [-90, -45, 0, 45, 90]),
    ((0.0, math.pi), [0, 45, 90, 135, 180]),
    ((math.pi / 2, 1.5 * math.pi), [-135, -90, 90, 135, 180]),  # across the back
    ((math.radians(44.9), math.radians(45.1)), [45]),
    ((math.radians(-400), math.radians(-350)), [0]),
    ((-math.pi, math.pi), [-135, -90, -45, 0, 45, 90, 135, 180]),
]


@pytest.mark.parametrize(("window", "within"), WINDOWS)
def test_beams_in_the_window_alone_count(window: tuple[float, float], within: list[float]) -> None:
    degrees = [-135.0, -90.0, -45.0, 0.0, 45.0, 90.0, 135.0, 180.0]
    inside = sorted({d for d in degrees if _between(d, window)})
    assert inside == sorted(set(within) & set(degrees))
    scan = fan(degrees, [1.0 + 0.1 * i for i in range(8)])
    kept = fan(inside, [1.0 + 0.1 * degrees.index(d) for d in inside])
    sensor = BeamSensor(angle_min=window[0], angle_max=window[1])
    assert votes_of(build_map([scan], 0.1, sensor=sensor)) == votes_of(build_map([kept], 0.1))
    outside = 8 - len(inside)
    assert counts([scan], sensor) == (
        len(inside),
        {"beam.outside_angles": outside} if outside else {},
    )


def _between(degrees: float, window: tuple[float, float]) -> bool:
    low, high = (math.degrees(limit) for limit in window)
    return any(low - 1e-6 <= degrees + turn <= high + 1e-6 for turn in (-720, -360, 0, 360, 720))


def test_one_limit_alone() -> None:
    scan = fan([-170, -10, 10, 170], [1.0, 1.0, 1.0, 1.0])
    assert counts([scan], BeamSensor(angle_min=0.0)) == (2, {"beam.outside_angles": 2})
    assert counts([scan], BeamSensor(angle_max=0.0)) == (2, {"beam.outside_angles": 2})


def test_the_first_reason_counts() -> None:
    """A beam outside is that, whatever it reads; one of no direction is inside of no window."""
    scan = fan([0, 90, 90, 90], [np.nan, np.nan, 0.01, 1.0])
    scan.directions[0] = np.nan
    sensor = BeamSensor(angle_min=-1.0, angle_max=1.0, range_min=0.1)
    empty = fan([90], [1.0])
    used = fan([0], [1.0])
    expected = {"beam.outside_angles": 4, "beam.nan": 1, "scan.empty": 2}
    assert counts([scan, empty, used], sensor) == (1, expected)


def test_scans_without_a_usable_pose_have_their_beams_counted_nowhere() -> None:
    good, seen = fan([0, 90], [1.0, 1.0]), np.array([[0.0, 1.0]])
    lost = [Scan(Pose2(x, 0.0, 0.0), seen, np.ones(1)) for x in (math.nan, 1e18)]
    sensor = BeamSensor(angle_min=-1.0, angle_max=1.0, range_max=5.0)
    expected = {"beam.outside_angles": 1, "scan.nan_pose": 1, "scan.pose_too_far": 1}
    assert counts([good, *lost], sensor) == (1, expected)
    beams, used, skipped = usable_beams([good, *lost], sensor, 0.1)
    assert (len(beams), used, skipped) == (1, 1, expected)


def test_a_full_map_heeds_the_window() -> None:
    """Its beams are those of the filter."""
    sensor = BeamSensor(range_max=5.0, angle_min=-1.0, angle_max=1.0)
    scan, kept = fan([0, 90], [1.0, 1.0]), fan([0], [1.0])
    whole = build_full_map([scan], 0.25, sensor=sensor)
    part = build_full_map([kept], 0.25, sensor=BeamSensor(range_max=5.0))
    np.testing.assert_array_equal(whole.cells()[0], part.cells()[0])
    assert whole.report is not None
    assert whole.report.skipped == {"beam.outside_angles": 1}


def test_scans_go_on_sharing_their_directions_and_keep_what_belongs_to_beams() -> None:
    first = fan([0, 90], [1.0, 2.0], beam_times_ns=np.array([5, 6]))
    second = Scan(Pose2(1.0, 0.0, 0.0), first.directions, np.array([3.0, 4.0]),
                  beam_origins=np.array([[0.1, 0.0], [0.2, 0.0]]))  # fmt: skip
    (a, b), lost = beams_within([first, second], (1.0, 2.0))
    assert a.directions is b.directions
    assert (a.ranges.tolist(), b.ranges.tolist()) == ([2.0], [4.0])
    assert a.beam_times_ns is not None
    assert a.beam_times_ns.tolist() == [6]
    assert b.beam_origins is not None
    assert b.beam_origins.tolist() == [[0.2, 0.0]]
    assert sorted(lost.values()) == [1, 1]


def test_a_map_is_the_same_with_threads() -> None:
    scans = [fan(list(range(-180, 180, 3)), [2.0 + 0.01 * k] * 120, 0.1 * k) for k in range(300)]
    sensor = BeamSensor(**BOX, angle_min=-2.0, angle_max=1.0)
    one, two = EvidenceMap(0.1), EvidenceMap(0.1)
    first = add_scans(one, scans, sensor=sensor)
    second = add_scans(two, scans, sensor=sensor, threads=2)
    assert votes_of(one) == votes_of(two)
    assert first.skipped == second.skipped
    assert first.skipped["beam.outside_angles"] > 0


def test_projective_images_refuse_what_is_for_2d() -> None:
    camera = PinholeCamera(5.0, 5.0, 1.0, 1.0, 3, 3)
    image = DepthScan(Pose3(np.zeros(3), np.eye(3)), np.ones((3, 3), np.float32), camera)
    for sensor in (BeamSensor(**BOX), BeamSensor(angle_max=1.0)):
        for method in ("rays", "projective"):
            with pytest.raises(ConfigError, match=r"these are 3D|these scans are 3D"):
                build_map([image], 0.1, sensor=sensor, method=method)
