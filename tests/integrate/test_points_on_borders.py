# SPDX-License-Identifier: Apache-2.0
"""What was measured as a point marks the cell of that point, also on a border of cells."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from oddsmap import BeamSensor, Pose2, Pose3, Scan, build_map
from oddsmap.scans.depth_image import DepthScan, PinholeCamera

CAMERA = PinholeCamera(fx=525.0, fy=525.0, cx=319.5, cy=239.5, width=640, height=480)
# 2 m lies at 40 cells, in real numbers and in doubles; the rest is off the borders.
RESOLUTION = 0.05
AXES = [
    np.array(rows, np.float64)
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
    if round(np.linalg.det(rows := np.eye(3)[list(order)] * signs)) == 1
]


def wall(depth: float, pose: Pose3) -> DepthScan:
    return DepthScan(pose, np.full((480, 640), depth, np.float32), CAMERA)


@pytest.mark.parametrize("method", ["rays", "projective"])
@pytest.mark.parametrize("depth", [0.5, 1.0, 1.25, 2.0, 3.0, 4.5])
def test_a_flat_wall_is_one_cell_thick(depth: float, method: str) -> None:
    pose = Pose3(np.array([0.012, 0.013, 0.0]), np.eye(3))
    world = build_map([wall(depth, pose)], resolution=RESOLUTION, method=method)
    index, hits, _ = world.cells()
    assert set(index[hits > 0, 2].tolist()) == {np.floor(depth / RESOLUTION)}


def test_the_wall_turned_to_each_side() -> None:
    for rotation in AXES:
        pose = Pose3(np.array([0.0, 0.0, 0.0]), rotation)
        index, hits, _ = build_map([wall(2.0, pose)], resolution=RESOLUTION).cells()
        forward = rotation[:, 2]
        axis = int(np.argmax(np.abs(forward)))
        assert set(index[hits > 0, axis].tolist()) == {40 if forward[axis] > 0 else -40}


def test_a_wall_of_a_cloud() -> None:
    rng = np.random.default_rng(1)
    points = np.column_stack([np.full(20_000, 2.0), rng.uniform(-3, 3, (20_000, 2))])
    scan = Scan.from_points(Pose3(np.zeros(3), np.eye(3)), points)
    index, hits, _ = build_map([scan], resolution=RESOLUTION).cells()
    assert set(index[hits > 0, 0].tolist()) == {40}
    expected = {tuple(cell) for cell in np.floor(points / RESOLUTION).astype(int).tolist()}
    assert {tuple(cell) for cell in index[hits > 0].tolist()} == expected


def test_scans_with_and_without_points_side_by_side() -> None:
    """The batch that a scan is cut in changes nothing."""
    rng = np.random.default_rng(2)
    pose = Pose3(np.zeros(3), np.eye(3))
    points = Scan.from_points(pose, np.column_stack([np.full(500, 2.0), rng.normal(size=(500, 2))]))
    beams = Scan(pose, points.directions, points.ranges)
    assert beams.measured_points is None
    sensor = BeamSensor(hit_width=0.1)
    together = build_map([points, beams, points], resolution=RESOLUTION, sensor=sensor)
    alone = build_map([points], resolution=RESOLUTION, sensor=sensor)
    for scan in (beams, points):
        alone.merge(build_map([scan], resolution=RESOLUTION, sensor=sensor))
    for one, other in zip(together.cells(), alone.cells(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_wall_of_points_in_a_window_of_angles() -> None:
    """What the window leaves of a scan marks as it does without it."""
    points = np.column_stack([np.full(500, 2.0), np.linspace(-1.9, 1.9, 500)])
    points = np.concatenate([points, points * (-1.0, 1.0)])
    scan = Scan.from_points(Pose2(0.0, 0.0, 0.0), points)
    ahead = BeamSensor(angle_min=-1.0, angle_max=1.0)
    index, hits, _ = build_map([scan], resolution=RESOLUTION, sensor=ahead).cells()
    assert set(index[hits > 0, 0].tolist()) == {40}
    assert len(index[hits > 0]) == len(np.unique(np.floor(points[:500, 1] / RESOLUTION)))
