# SPDX-License-Identifier: Apache-2.0
"""No-returns that look like a ring of walls: with noise on them, or below range_max."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import Pose2, Scan
from oddsmap.array_types import FloatArray
from oddsmap.scans.note import Note

BEAMS = 240
FAR = 5.0


def room(change: Callable[[FloatArray, np.random.Generator], FloatArray]) -> list[Scan]:
    """A robot that drives through a hall of 12 x 7 m: ranges, as they are changed."""
    rng = np.random.default_rng(3)
    angles = np.arange(BEAMS) * (2 * math.pi / BEAMS)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    scans = []
    for k in range(40):
        at = np.array([-2.0 + 0.1 * k, 0.02 * k])
        with np.errstate(divide="ignore"):
            ends = (np.where(ways > 0, [6.0, 3.5], [-6.0, -3.5]) - at) / ways
        ranges = ends.min(axis=1) + rng.normal(0.0, 0.01, BEAMS)
        scans.append(Scan(Pose2(float(at[0]), float(at[1]), 0.0), ways, change(ranges, rng)))
    return scans


def clipped(ranges: FloatArray, rng: np.random.Generator) -> FloatArray:
    """As Gazebo does it: noise on range_max, and what is above becomes range_max."""
    noisy = np.where(ranges > FAR, FAR + rng.normal(0.0, 0.02, len(ranges)), ranges)
    return np.minimum(noisy, FAR)


def unclipped(ranges: FloatArray, rng: np.random.Generator) -> FloatArray:
    return np.where(ranges > FAR, FAR + rng.normal(0.0, 0.02, len(ranges)), ranges)


def code(ranges: FloatArray, _: np.random.Generator) -> FloatArray:
    return np.where(ranges > FAR, 4.99, ranges)


def none(ranges: FloatArray, _: np.random.Generator) -> FloatArray:
    return np.where(ranges > FAR, np.inf, ranges)


def named(log: Any, range_max: float | None = FAR) -> list[Note]:
    found = oddsmap.check_log(log, range_max=range_max)
    return [doubt for doubt in found if doubt.code == "range.smeared_no_returns"]


@pytest.mark.parametrize(
    ("change", "limits"),
    [(clipped, (5.0, math.inf)), (unclipped, (5.0,)), (code, (5.0, math.inf))],
)
def test_it_is_named_with_a_remedy_that_helps(change: Any, limits: tuple[float, ...]) -> None:
    scans = room(change)
    for limit in limits:
        (doubt,) = named(scans, limit)
        assert doubt.severity == "warning"
        remedy = float(doubt.split("sensor.range_max=")[1].split()[0])
        assert 4.85 <= remedy < 4.98
        assert named(scans, remedy) == []


def test_no_returns_that_are_infinite_are_not_named() -> None:
    assert named(room(none)) == []


def test_a_robot_in_a_round_tower_is_not_named() -> None:
    scans = room(lambda ranges, rng: 4.0 + rng.normal(0.0, 0.02, len(ranges)))
    assert named(scans) == []


def test_a_wall_at_the_end_of_the_range_in_a_few_scans_is_not_named() -> None:
    numbers = iter(range(40))

    def at_the_end(ranges: FloatArray, rng: np.random.Generator) -> FloatArray:
        return clipped(ranges, rng) if next(numbers) % 4 == 0 else none(ranges, rng)

    assert named(room(at_the_end)) == []


RECORDINGS = [
    ("guardian_3", "/scan", None),
    ("guardian_3", "/hokuyo_back_scan", None),
    ("jarvis_complex_path_fast", "/driver_laser_navigation/laser_scan", "map"),
    ("jarvis_complex_path_fast", "/driver_laser_security/laser_scan", "map"),
    ("palette_facing_windows", "/guardian/laser_tilt_front", None),
    ("palette_facing_windows", "/guardian/laser_horizontal_back", None),
]
SIMULATED = "ship_interior_with_tilting_laser"


@pytest.mark.slow  # these bags are compressed with bzip2
@pytest.mark.realdata
@pytest.mark.parametrize(("name", "topic", "frame"), RECORDINGS)
def test_good_recordings(name: str, topic: str, frame: str | None, data_folder: Path) -> None:
    path = data_folder / "ros" / "ros1" / f"{name}.bag"
    assert oddsmap.check_log(oddsmap.open_log(path, scans=topic, frame=frame)) == ()


@pytest.mark.realdata
@pytest.mark.parametrize(
    "name",
    [
        "la3dm_sim_structured.bag",
        "ros1/tilt_laser.bag",
        pytest.param("turtlebot3_gazebo.bag", marks=pytest.mark.slow),
    ],
)
def test_other_good_recordings(name: str, data_folder: Path) -> None:
    assert named(oddsmap.open_log(data_folder / "ros" / name), None) == []


@pytest.mark.realdata
@pytest.mark.parametrize(
    "topic", ["/tilt_scan", pytest.param("/base_scan", marks=pytest.mark.slow)]
)
def test_a_simulated_recording_with_noise(topic: str, data_folder: Path) -> None:
    path = data_folder / "ros" / "ros1" / f"{SIMULATED}.bag"
    scans = list(oddsmap.open_log(path, scans=topic, frame="odom"))
    (doubt,) = named(scans)
    remedy = float(doubt.split("sensor.range_max=")[1].split()[0])
    assert 4.9 < remedy < 4.99
    assert named(scans, remedy) == []


@pytest.mark.realdata
def test_good_logs_of_beams(data_folder: Path) -> None:
    sonars = sorted((data_folder / "sonar_bench").glob("*.npz"))[::6]
    lasers = sorted((data_folder / "laser2d").glob("*.log.gz"))
    clouds = [data_folder / "lidar3d" / name for name in ("hku1_avia", "hall_os0")]
    assert sonars
    for path in [*sonars, *lasers, *clouds]:
        assert oddsmap.check_log(oddsmap.open_log(path)) == (), path
