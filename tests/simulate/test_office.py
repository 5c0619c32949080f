# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest

from oddsmap.errors import ConfigError
from oddsmap.simulate import Disc, Lidar2D, Rectangle, office_drive, office_plan
from tests.naive import floor_plan_oracle as oracle


def test_the_drive_keeps_its_distance() -> None:
    plan = office_plan()
    for pose in office_drive(2000):
        assert not oracle.contains(plan, (pose.x, pose.y))
        assert oracle.distance_to_obstacles(plan, (pose.x, pose.y)) > 0.3


def test_the_drive_is_smooth_and_heads_where_it_goes() -> None:
    poses = office_drive()
    assert len(poses) == 320
    xy = np.array([(pose.x, pose.y) for pose in poses])
    theta = np.array([pose.theta for pose in poses])
    steps = np.diff(xy, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    assert lengths.max() < 0.35
    assert lengths.min() > 0.25  # the chords of the sharpest corners
    turns = np.abs((np.diff(theta) + math.pi) % (2 * math.pi) - math.pi)
    assert math.degrees(turns.max()) < 35
    # The motion from the pose before to the pose after has the heading of the pose between.
    motion = np.arctan2(xy[2:, 1] - xy[:-2, 1], xy[2:, 0] - xy[:-2, 0])
    off = np.abs((motion - theta[1:-1] + math.pi) % (2 * math.pi) - math.pi)
    assert math.degrees(off.max()) < 12


def test_the_drive_enters_every_room() -> None:
    rooms = {
        "south-west": (0, 0, 5.5, 6), "south": (5.5, 0, 11, 6), "hall": (11, 0, 20, 6),
        "north-west": (0, 8, 4, 14), "meeting": (5.6, 8, 9.4, 14), "kitchen": (9.4, 8, 13.5, 14),
        "lobby": (13.5, 8, 20, 14), "corridor": (0, 6, 13.5, 8),
    }  # fmt: skip
    poses = office_drive()
    for name, (x0, y0, x1, y1) in rooms.items():
        assert sum(x0 < pose.x < x1 and y0 < pose.y < y1 for pose in poses) >= 10, name


def test_the_building_is_closed() -> None:
    lidar = Lidar2D(beam_count=720, angle_step=math.pi / 360, sigma=0.0)
    plan, rng = office_plan(), np.random.default_rng(0)
    assert all(np.isfinite(lidar.scan(plan, pose, rng).ranges).all() for pose in office_drive(50))


def test_no_symmetry() -> None:
    grid = office_plan().rasterise(0.1, (-30, -60), (230, 200))  # a square around the middle
    for image in (grid.T, grid[::-1], grid[:, ::-1], grid[::-1, ::-1], np.rot90(grid)):
        assert np.mean(image != grid) > 0.02


@pytest.mark.parametrize("resolution", [0.05, 0.1])
def test_an_exact_reading_of_a_face_along_the_axes_marks_a_cell_that_is_occupied(
    resolution: float,
) -> None:
    plan = office_plan()
    cells = round(24 / resolution)
    first = round(-2 / resolution)
    truth = plan.rasterise(resolution, (first, first), (first + cells, first + cells))
    lidar = Lidar2D(beam_count=361, angle_step=math.pi / 180, sigma=0.0)
    rng = np.random.default_rng(0)
    for pose in office_drive(40):
        scan = lidar.scan(plan, pose, rng)
        ends = pose.transform(scan.directions * scan.ranges[:, None])
        # On a face along the axes one coordinate is 0.02 or 0.08 beyond a multiple of 0.1 m.
        along_axis = (np.abs(np.abs(ends % 0.1 - 0.05) - 0.03) < 1e-9).any(axis=1)
        index = np.floor(ends[along_axis] / resolution).astype(int) - first
        # A point of the slanted wall can have such a coordinate by chance.
        assert np.mean(truth[index[:, 1], index[:, 0]]) > 0.99
        assert along_axis.sum() > 150


def test_faces_along_the_axes_are_off_the_borders_of_cells() -> None:
    for shape in office_plan().obstacles:
        if isinstance(shape, Disc):
            continue
        ring = shape.vertices
        ahead = np.roll(ring, -1, axis=0)
        for axis in (0, 1):
            face = ring[ring[:, axis] == ahead[:, axis], axis]
            offset = face / 0.1 - np.round(face / 0.1)
            if isinstance(shape, Rectangle):
                np.testing.assert_allclose(np.abs(offset), 0.2, atol=1e-9)


def test_too_few_poses_are_refused() -> None:
    with pytest.raises(ConfigError, match="pose_count must be at least 2, got 1"):
        office_drive(1)
