# SPDX-License-Identifier: Apache-2.0
"""Sonars: cones along the x axis of their frames, one topic each or all on one."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from oddsmap import ConeSensor, Pose2, Scan, build_map, open_log
from oddsmap.errors import InputError
from oddsmap.recordings.scan_messages import RANGE, beams_of
from tests.kit import votes_of
from tests.recordings.bags import CONTAINERS, Messages, Said
from tests.recordings.test_recorded_log import SECOND, START

SIDES = {"front": 0.0, "left": math.pi / 2, "right": -math.pi / 2}


@pytest.fixture
def ros() -> Messages:
    return Messages("bag")


def ring(messages: Messages, *, one_topic: bool = False) -> list[Said]:
    """A robot that drives along x with three sonars; 8 readings of each."""
    said: list[Said] = []
    for side, yaw in SIDES.items():
        fixed = messages.transform(START, "base", side, (0.1, 0.0, 0.2), yaw)
        said.append(("/tf_static", START, messages.tf(fixed)))
    for k in range(8):
        now = START + k * SECOND // 10
        moved = messages.transform(now, "map", "base", (0.2 * k, 0.0, 0.0), 0.0)
        said.append(("/tf", now, messages.tf(moved)))
        for i, side in enumerate(SIDES):
            topic = "/sonar" if one_topic else f"/sonar/{side}"
            said.append((topic, now, messages.range(now, side, 1.5 + 0.25 * i)))
    return said


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize("one_topic", [True, False])
def test_a_ring_of_sonars_maps_the_plane(container: str, one_topic: bool, tmp_path: Path) -> None:
    messages = Messages(container)
    path = messages.write(tmp_path / "run", ring(messages, one_topic=one_topic))
    topics = [] if one_topic else [f"/sonar/{side}" for side in SIDES]
    log = open_log(path, scans=topics)
    assert dict(log.sensor) == pytest.approx(
        {"range_min": 0.1, "range_max": 4.0, "cone_deg": math.degrees(0.5)}, rel=1e-6
    )
    ids = {f"/sonar {side}" if one_topic else f"/sonar/{side} {side}" for side in SIDES}
    assert set(log.sensors) == {scan.sensor_id for scan in log} == ids
    want = [
        Scan(Pose2(0.2 * k + 0.1, 0.0, yaw), np.array([[1.0, 0.0]]), np.array([1.5 + 0.25 * i]))
        for k in range(8)
        for i, yaw in enumerate(SIDES.values())
    ]
    sensor = ConeSensor(cone_deg=28.6479, range_min=0.1, range_max=4.0)
    made = build_map(log, 0.1)
    assert made.sensor == sensor
    assert votes_of(made) == votes_of(build_map(want, 0.1, sensor=sensor))


def test_a_cone_lies_in_the_plane_whatever_way_up_it_is(ros: Messages, tmp_path: Path) -> None:
    said = ring(ros)
    turn = said[0][2].transforms[0].transform.rotation
    turn.x, turn.w = math.sin(math.pi / 4), math.cos(math.pi / 4)  # rolled by 90 degrees
    path = ros.write(tmp_path / "run", said)
    assert next(iter(open_log(path, scans="/sonar/front"))).directions.shape == (1, 2)


def test_a_cone_that_looks_down_maps_in_space(ros: Messages, tmp_path: Path) -> None:
    said = ring(ros)
    turn = said[0][2].transforms[0].transform.rotation
    turn.y, turn.w = math.sin(math.pi / 4), math.cos(math.pi / 4)
    log = open_log(ros.write(tmp_path / "run", said), scans="/sonar/front")
    assert next(iter(log)).directions.shape == (1, 3)
    assert "sensor points up or down: it is mapped in 3D" in log.notes[0]


def test_readings_that_say_nothing(ros: Messages, tmp_path: Path) -> None:
    said = ring(ros)
    odd = (math.inf, -math.inf, math.nan, 0.05, 4.0, 5.0)
    readings = [message for topic, _, message in said if topic == "/sonar/front"]
    for message, value in zip(readings, odd, strict=False):
        message.range = value
    made = build_map(open_log(ros.write(tmp_path / "run", said), scans="/sonar/front"), 0.1)
    assert made.report is not None
    # +Inf clears, two readings are returns.
    assert made.report.beams == 3
    assert made.report.skipped == {
        "beam.nan": 1,
        "beam.below_range_min": 2,
        "beam.no_return": 2,
        "scan.empty": 5,
    }


def test_a_ranger_that_tells_only_whether_something_is_near(ros: Messages) -> None:
    message = ros.range(START, "front", -math.inf, limits=(0.8, 0.8))
    with pytest.raises(InputError, match=r"both 0.8 m: such a ranger tells whether something is n"):
        beams_of(RANGE, message)


@pytest.mark.parametrize("angle", [30.0, -0.1, math.nan])
def test_an_angle_that_is_none(angle: float, ros: Messages) -> None:
    with pytest.raises(InputError, match=r"a field of view of .* rad"):
        beams_of(RANGE, ros.range(START, "front", 1.0, angle=angle))


def test_limits_that_cross(ros: Messages) -> None:
    with pytest.raises(InputError, match="min_range 4 m lies above max_range 1 m"):
        beams_of(RANGE, ros.range(START, "front", 1.0, limits=(4.0, 1.0)))


def test_without_an_angle_it_is_a_narrow_beam_with_a_doubt(ros: Messages, tmp_path: Path) -> None:
    said = ring(ros)
    for topic, _, message in said:
        if topic == "/sonar/left":
            message.field_of_view = 0.0
    path = ros.write(tmp_path / "run", said)
    log = open_log(path, scans="/sonar/left")
    assert "cone_deg" not in log.sensor
    assert [note.code for note in log.notes] == ["cone.missing"]
    with pytest.raises(InputError, match="/sonar/front front has wide beams, /sonar/left left has"):
        open_log(path, scans=["/sonar/left", "/sonar/front"])


def test_limits_that_change_are_told(ros: Messages, tmp_path: Path) -> None:
    said = ring(ros)
    readings = [message for topic, _, message in said if topic == "/sonar/front"]
    readings[-1].max_range = 5.0
    log = open_log(ros.write(tmp_path / "run", said), scans="/sonar/front")
    list(log)
    assert [str(note) for note in log.notes] == [
        "1 scans of /sonar/front front state other limits than its first one, which count"
    ]
