# SPDX-License-Identifier: Apache-2.0
"""The page gets the poses and times of a log, and beams that end where readings do."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import BeamSensor, Scan
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.viewer.drawn_beams import beams_of
from oddsmap.viewer.journey import kept_beams, read_journey
from oddsmap.viewer.journey_payload import journey_payload
from tests import memory_kit
from tests.kit import random_scans
from tests.kit3d import random_space_scans
from tests.viewer.journey_kit import ReadJourney, log_of, read_payload

TURN = 2 * math.pi / 65536
SENSOR = BeamSensor(range_max=5.0)


def read(log: Any, beams: int = 0, sensor: BeamSensor = SENSOR) -> ReadJourney:
    return read_payload(journey_payload(read_journey(log, {"": sensor}, beams=beams), {"log": "x"}))


def apart(a: float, b: float) -> float:
    """The angle between two directions."""
    return abs((a - b + math.pi) % (2 * math.pi) - math.pi)


metres = st.floats(-1e6, 1e6)
poses = st.builds(Pose2, metres, metres, st.floats(-10.0, 10.0) | st.just(math.nan))
stamps = st.none() | st.integers(0, 2**62)


@given(st.lists(st.tuples(poses, stamps, st.sampled_from(["", "left", "right"])), min_size=1))
def test_poses_and_times(made: list[tuple[Pose2, int | None, str]]) -> None:
    scans = [Scan(pose, np.array([[1.0, 0.0]]), np.array([1.0]), stamp) for pose, stamp, _ in made]
    scans = [
        dataclasses.replace(scan, sensor_id=name)
        for scan, (*_, name) in zip(scans, made, strict=True)
    ]
    found = read(scans)
    assert found.facts["scans"] == len(made)
    first = min((stamp for _, stamp, _ in made if stamp is not None), default=0)
    for i, (pose, stamp, name) in enumerate(made):
        assert found.sensors[i] == name
        place, time = found.places[i], found.times[i]
        if not pose.is_finite:
            assert place is None
        else:
            assert place == pytest.approx((pose.x, pose.y), abs=found.facts["unit"] * 0.501 + 1e-9)
            assert apart(found.yaw[i], pose.theta) <= TURN * 0.501
        if stamp is None:
            assert time is None
        else:
            assert time == pytest.approx((stamp - first) / 1e9, abs=found.facts["time_unit"])


def test_units_are_fine_where_spans_are_short() -> None:
    facts = read(log_of(random_scans(1, 8))).facts
    assert (facts["unit"], facts["time_unit"]) == (1e-4, 1e-4)
    assert facts["first_stamp"] == f"{10**9}.000000"
    assert facts["log"] == "x"


@pytest.mark.parametrize("scans", [random_scans(2, 6), random_space_scans(2, 6)], ids=["2D", "3D"])
def test_beams_end_where_readings_do(scans: list[Scan]) -> None:
    found = read(log_of(scans), beams=1000)
    for i, scan in enumerate(scans):
        # One beam after the other, by hand.
        ends, seen = [], []
        for direction, reading in zip(scan.directions, scan.ranges.tolist(), strict=True):
            if math.isnan(reading) or reading <= 0.0:
                continue
            way = scan.map_from_sensor.rotation @ direction
            returned = reading < 5.0
            # +Inf clears up to range_max; a finite one from there on is drawn as far as it says.
            ends.append(way * (5.0 if math.isinf(reading) else reading))
            seen.append(returned)
        assert found.returned[i] == seen
        assert np.allclose(found.ends[i], ends, atol=3e-3)


def test_where_a_camera_looks() -> None:
    """Along z, not along x."""
    image = memory_kit.images()[0]
    found = read([image])
    ahead = image.map_from_sensor.rotation[:, 2]
    assert apart(found.yaw[0], math.atan2(ahead[1], ahead[0])) <= TURN
    assert apart(found.pitch[0], math.asin(ahead[2])) <= TURN


def test_what_has_no_beams() -> None:
    labels = memory_kit.overhead()[:3]
    found = read(labels, beams=9)
    assert found.ends == [[], [], []]
    lost = dataclasses.replace(random_scans(1, 1)[0], map_from_sensor=Pose2(math.nan, 0.0, 0.0))
    found = read([lost], beams=9)
    assert (found.places, found.ends) == ([None], [[]])


def test_beams_are_chosen_evenly_and_counted() -> None:
    ranges = np.where(np.arange(1000) % 10 == 3, np.nan, 2.0)
    angles = np.linspace(-math.pi, math.pi, 1000)
    scan = Scan.from_angles((0.0, 0.0, 0.0), angles, ranges)
    found = beams_of(scan, SENSOR, 90)
    assert (found.size, found.readings, found.silent) == (90, 1000, 100)
    speaks = np.flatnonzero(~np.isnan(ranges))
    assert np.allclose(np.arctan2(found.ends[:, 1], found.ends[:, 0]), angles[speaks[::10]])


def test_beams_that_start_elsewhere() -> None:
    """They start there, and end where they ended."""
    scan = random_space_scans(4, 1)[0]
    origins = np.random.default_rng(1).uniform(-0.5, 0.5, scan.directions.shape)
    scan = dataclasses.replace(scan, beam_origins=origins)
    pose = scan.map_from_sensor
    found = beams_of(scan, SENSOR, 1000)
    seen = np.isfinite(scan.ranges) & (scan.ranges < 5.0)
    assert isinstance(pose, Pose3)
    assert np.allclose(found.starts[found.returned], pose.transform(origins[seen]))
    ends = origins + scan.directions * scan.ranges[:, None]
    assert np.allclose(found.ends[found.returned], pose.transform(ends[seen]))
    kept = read([scan], beams=1000)
    want = found.ends - pose.translation
    assert np.allclose(kept.ends[0], want, atol=3e-3)


def test_without_a_range_no_returns_end_with_the_farthest_return() -> None:
    scan = Scan.from_angles((0.0, 0.0, 0.0), [0.0, 1.0, 2.0], [math.inf, 3.0, 7.0])
    found = beams_of(scan, BeamSensor(), 9)
    assert found.returned.tolist() == [False, True, True]
    assert np.allclose(np.hypot(*found.ends.T), [7.0, 3.0, 7.0])


@pytest.mark.parametrize(("scans", "beams"), [(1, 101), (3000, 101), (6000, 50), (10**6, 11)])
def test_how_many_beams_a_file_holds(scans: int, beams: int) -> None:
    assert kept_beams(scans) == beams


def test_a_log_is_read_once() -> None:
    """And none of its scans is kept."""
    log = log_of(random_scans(1, 5))
    done: list[int] = []
    times = 0

    class Counted(LoadedLog):
        def __iter__(self) -> Any:
            nonlocal times
            times += 1
            return iter(self.scans)

    counted = Counted(**{f.name: getattr(log, f.name) for f in dataclasses.fields(log)})
    journey = read_journey(counted, {}, progress=done.append)
    assert (times, done, journey.beams) == (1, [1, 2, 3, 4, 5], ())
