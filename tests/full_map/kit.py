# SPDX-License-Identifier: Apache-2.0
"""Beams, rooms and comparisons for the tests of full-map estimation."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from oddsmap.config.full_map import FullMapConfig
from oddsmap.full_map.estimator import build_full_map
from oddsmap.full_map.full_map import FullMap
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.scan import Scan
from oddsmap.sensors.cone import ConeSensor
from oddsmap.simulate import Sonar2D

RESOLUTION = 0.1
SONAR = ConeSensor(cone_deg=25.0, range_max=3.0)
TOF = ConeSensor(cone_deg=8.0, range_max=4.0)


def beam(x: float, y: float, heading: float, z: float) -> Scan:
    """One beam of the plane as a scan."""
    way = np.array([[math.cos(heading), math.sin(heading)]])
    return Scan(Pose2(x, y, 0.0), way, np.array([z]))


def room(count: int, seed: int = 0) -> list[Scan]:
    """Scans of 12 sonars along a line through a room of 6 x 4 m with a box in it."""
    truth = np.ones((40, 60), np.bool_)
    truth[1:-1, 1:-1] = False
    truth[25:30, 20:30] = True
    rng = np.random.default_rng(seed)
    sonar = Sonar2D(beam_count=12, range_max=3.0, p_random=0.02, p_dropout=0.02)
    xs = np.linspace(1.03, 4.97, count)
    return [sonar.scan(truth, RESOLUTION, Pose2(float(x), 1.21, float(x)), rng) for x in xs]


def wall_of_space(depth: float, count: int, seed: int = 0) -> list[Scan]:
    """Time-of-flight frames of 5 x 5 zones, of a wall of space at x = depth, from before it."""
    rng = np.random.default_rng(seed)
    angles = np.radians(np.linspace(-16.0, 16.0, 5))
    az, el = (a.ravel() for a in np.meshgrid(angles, angles))
    ways = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], axis=1)
    scans = []
    for _ in range(count):
        at = np.array([0.05, *rng.uniform(-0.5, 0.5, 2)])
        # The nearest point of the wall inside a zone's cone of 8 degrees.
        slant = np.maximum(np.arccos(ways[:, 0]) - math.radians(4.0), 0.0)
        z = (depth - at[0]) / np.cos(slant) + rng.normal(0.0, 0.02, len(ways))
        scans.append(Scan(Pose3(at, np.eye(3)), ways, z))
    return scans


def moved(scans: Sequence[Scan], by: tuple[float, float]) -> list[Scan]:
    """The same scans from elsewhere in the plane [m]."""
    there = []
    for scan in scans:
        pose = scan.map_from_sensor
        assert isinstance(pose, Pose2)
        elsewhere = Pose2(pose.x + by[0], pose.y + by[1], pose.theta)
        there.append(Scan(elsewhere, scan.directions, scan.ranges))
    return there


def estimated(scans: Sequence[Scan], *, threads: int = 1, **settings: object) -> FullMap:
    """The full map of scans of SONAR, or of TOF in space."""
    sensor = SONAR if isinstance(scans[0].map_from_sensor, Pose2) else TOF
    chosen = FullMapConfig(**settings)  # type: ignore[arg-type]
    return build_full_map(scans, RESOLUTION, sensor=sensor, settings=chosen, threads=threads)


def same(one: FullMap, other: FullMap) -> bool:
    """Equal to the bit, also where nothing was observed."""
    lo = np.minimum(one.blocks.min(axis=0), other.blocks.min(axis=0)) * one.side
    hi = (np.maximum(one.blocks.max(axis=0), other.blocks.max(axis=0)) + 1) * one.side
    box = (lo, hi)
    return np.array_equal(one.log_odds(box), other.log_odds(box)) and np.array_equal(
        one.marks_of(box), other.marks_of(box)
    )
