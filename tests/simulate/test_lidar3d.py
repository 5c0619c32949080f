# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose3
from oddsmap.simulate import Box, Cylinder, Ground, Lidar3D, World3D, drive3d, town
from tests.naive import world3d_oracle as oracle

SMALL = Lidar3D(ring_count=9, column_count=32)
UPRIGHT = Pose3(np.array([0.0, 0.0, 1.5]), np.eye(3))


def test_the_beams() -> None:
    assert Lidar3D().directions.shape == (65536, 3)
    lidar = Lidar3D(ring_count=3, column_count=4, elevation_min=-0.5, elevation_max=0.5)
    rings = lidar.directions.reshape(3, 4, 3)
    np.testing.assert_allclose(np.linalg.norm(rings, axis=-1), 1.0)
    np.testing.assert_allclose(np.arcsin(rings[:, :, 2]), [[0.5] * 4, [0.0] * 4, [-0.5] * 4])
    np.testing.assert_allclose(rings[1, :, :2], [(1, 0), (0, 1), (-1, 0), (0, -1)], atol=1e-15)
    assert not lidar.directions.flags.writeable


def test_exact_without_noise() -> None:
    world = town(5)
    lidar = Lidar3D(ring_count=9, column_count=32, sigma=0.0)
    pose = drive3d(9, ground=world.ground)[4]
    scan = lidar.scan(world, pose, np.random.default_rng(0), stamp_ns=7)
    at = tuple(pose.translation.tolist())
    for t, way in zip(scan.ranges, (scan.directions @ pose.rotation.T).tolist(), strict=True):
        near, far = (oracle.cast(world, at, tuple(way), slack, 50.0) for slack in (1e-9, -1e-9))
        assert min(near, far) - 1e-7 <= t <= max(near, far) + 1e-7
    assert scan.directions is lidar.directions
    assert scan.map_from_sensor is pose
    assert scan.stamp_ns == 7


def test_the_pose_turns_the_beams() -> None:
    # A wall to the left of the map's x axis is ahead of a sensor that looks to the left.
    world = World3D([Box(0, 6, 20, 2, 0, 9)])
    left = Pose3(np.array([0.0, 0.0, 1.0]), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]))
    lidar = Lidar3D(ring_count=1, column_count=4, elevation_min=0.0, elevation_max=0.0, sigma=0.0)
    scan = lidar.scan(world, left, np.random.default_rng(0))
    np.testing.assert_allclose(scan.ranges, [5.0, np.inf, np.inf, np.inf])


def test_noise_is_gaussian_with_sigma() -> None:
    # Every beam straight at a wall 5 m ahead.
    world = World3D([Box(5.5, 0, 1, 1, 0, 9)])
    lidar = Lidar3D(ring_count=20_000, column_count=1, elevation_min=0.0, elevation_max=0.0)
    errors = lidar.scan(world, UPRIGHT, np.random.default_rng(1)).ranges - 5.0
    assert abs(errors.mean()) < 5 * 0.02 / math.sqrt(20_000)
    assert abs(errors.std() / 0.02 - 1) < 5 / math.sqrt(2 * 20_000)


def test_beyond_range_max_is_no_return() -> None:
    world = World3D([], Ground())
    lidar = Lidar3D(ring_count=64, column_count=8, range_max=10.0)
    scan = lidar.scan(world, UPRIGHT, np.random.default_rng(1))
    seen = np.isfinite(scan.ranges)
    assert 0 < seen.sum() < len(seen)
    assert scan.ranges[seen].max() < 10.0
    assert np.isinf(scan.ranges[~seen]).all()
    down = lidar.directions[:, 2] < 0
    assert not seen[~down].any()
    assert seen[lidar.directions[:, 2] < -0.16].all()


def test_returns_only_leaves_out_the_others_alone() -> None:
    world = town(5)
    pose = drive3d(1, ground=world.ground)[0]
    whole = SMALL.scan(world, pose, np.random.default_rng(3))
    part = SMALL.scan(world, pose, np.random.default_rng(3), returns_only=True)
    seen = np.isfinite(whole.ranges)
    assert 0 < seen.sum() < len(seen)
    assert np.array_equal(part.ranges, whole.ranges[seen])
    assert np.array_equal(part.directions, whole.directions[seen])


def test_ranges_stay_positive_in_front_of_a_wall() -> None:
    world = World3D([Cylinder(1.001, 0, 1, 0, 3)])
    lidar = Lidar3D(ring_count=500, column_count=1, elevation_min=0.0, elevation_max=0.0)
    assert lidar.scan(world, UPRIGHT, np.random.default_rng(3)).ranges.min() == 1e-3


def test_the_statistics_that_the_benchmark_is_made_for() -> None:
    """About 60,000 returns of 65,536 and 65 cells of 0.2 m a beam, as in the design's data."""
    world, lidar = town(), Lidar3D(ring_count=32, column_count=128)
    rng = np.random.default_rng(0)
    returns, ranges, cells = [], [], []
    for pose in drive3d(10, ground=world.ground):
        scan = lidar.scan(world, pose, rng, returns_only=True)
        returns.append(len(scan.ranges) / len(lidar.directions))
        ranges.append(scan.ranges.mean())
        way = scan.directions @ pose.rotation.T * scan.ranges[:, None]
        cells.append(np.abs(way).sum() / 0.2 / len(way))
    assert 0.90 < np.mean(returns) < 0.97
    assert 9 < np.mean(ranges) < 12
    assert 60 < np.mean(cells) < 75


@pytest.mark.parametrize(
    "change",
    [
        {"ring_count": 0},
        {"column_count": 0},
        {"elevation_min": 0.5},
        {"elevation_max": 2.0},
        {"elevation_min": math.nan},
        {"range_max": math.inf},
        {"range_max": 0.0},
        {"sigma": -0.1},
        {"sigma": math.nan},
    ],
)
def test_a_parameter_out_of_range_is_refused(change: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=f"Lidar3D: .*{next(iter(change))}") as caught:
        Lidar3D(**change)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_a_pose_that_cannot_be_is_refused() -> None:
    world, rng = World3D([Box(0, 0, 2, 2, 0, 3)], Ground()), np.random.default_rng(0)
    with pytest.raises(InputError, match=r"\(0\.000, 0\.000, 1\.500\) stands inside"):
        SMALL.scan(world, UPRIGHT, rng)
    with pytest.raises(InputError, match="the ground"):
        SMALL.scan(world, Pose3(np.array([5.0, 5.0, -0.1]), np.eye(3)), rng)
    with pytest.raises(InputError, match="not finite"):
        SMALL.scan(world, Pose3(np.array([math.nan, 0, 0]), np.eye(3)), rng)


def test_a_sweep_takes_each_column_from_its_own_pose() -> None:
    lidar = Lidar3D(ring_count=3, column_count=8, sigma=0.0)
    world = World3D([Box(5.0, 0.0, 1.0, 30.0, 0.0, 9.0), Box(-5.0, 0.0, 1.0, 30.0, 0.0, 9.0)])
    poses = [Pose3(np.array([0.1 * c, 0.0, 2.0]), np.eye(3)) for c in range(8)]
    moving = lidar.sweep(world, poses, np.random.default_rng(0), stamp_ns=7, column_ns=5)
    assert moving.map_from_sensor is poses[0]
    assert moving.beam_times_ns is not None
    for column, pose in enumerate(poses):
        alone = lidar.scan(world, pose, np.random.default_rng(0))
        np.testing.assert_allclose(moving.ranges[column::8], alone.ranges[column::8], atol=1e-12)
        assert (moving.beam_times_ns[column::8] == 7 + 5 * column).all()
    with pytest.raises(InputError, match="one pose for each of 8 columns, got 2"):
        lidar.sweep(world, poses[:2], np.random.default_rng(0))
