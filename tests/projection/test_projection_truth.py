# SPDX-License-Identifier: Apache-2.0
"""Projections against the truth of a small world; `benchmarks/projection.py` has larger ones."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.projection import Trip, filled, shares
from oddsmap import Pose3
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.simulate import Box, Ground, Lidar3D, World3D


def test_floor_is_free_and_things_are_kept() -> None:
    boxes = (
        (3, 3, 0.8, 0.6, 1.2),
        (-4, 2, 1.0, 1.0, 0.5),
        (2, -4, 2.0, 0.5, 0.8),
        (-3, -3, 0.5, 1.5, 2.2),
    )
    things = [Box(x, y, length, width, 0.0, top, 0.3) for x, y, length, width, top in boxes]
    walls = [Box(0.0, y, 14.0, 0.3, 0.0, 2.6) for y in (-7.0, 7.0)]
    walls += [Box(x, 0.0, 0.3, 14.0, 0.0, 2.6) for x in (-7.0, 7.0)]
    world, rng = World3D([*things, *walls], Ground()), np.random.default_rng(1)
    lidar = Lidar3D(ring_count=32, column_count=360, elevation_min=math.radians(-30))
    angle = np.arange(12) * math.tau / 12
    way = np.stack([4.9 * np.cos(angle), 5.3 * np.sin(angle)], axis=1)
    poses = [Pose3(np.eye(3), np.array([x, y, 1.3])) for x, y in way]
    found = shares(Trip(world, [lidar.scan(world, pose, rng) for pose in poses], way, 0.1))
    slabs = found["slabs of 0.3 m"]
    assert slabs["free"] >= 0.95
    assert slabs["missed"] <= 0.01
    assert slabs["insides"] <= 0.02
    # What the other rules would do.
    assert found["largest"]["free"] < 0.9
    assert found["one slab"]["insides"] > 0.1
    assert slabs["occupied"] == found["largest"]["occupied"]


def test_the_true_columns() -> None:
    world = World3D(
        [Box(0.5, 0.25, 0.5, 0.5, 0.0, 1.0), Box(2.0, 0.25, 1.0, 0.5, 1.9, 2.5)], Ground()
    )
    nothing = np.zeros((2, 5))
    plane = ProbabilityMap(nothing, nothing > 0, 0.5, (0.0, 0.0))
    # The first box covers half of two columns; the other hangs above the band.
    assert filled(world, plane).tolist() == [[0.5, 0.5, 0.0, 0.0, 0.0], [0.0] * 5]
