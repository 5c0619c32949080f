# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose2
from oddsmap.simulate import GlassScene, GlassSensor, glass_path, glass_scene
from tests.naive.forward import plane_fraction

RAY = GlassSensor(beam_count=1, cone_deg=0.0, range_max=3.0, sigma=0.0)
POSE = Pose2(0.05, 0.55, 0.0)


def one_cell(reflectivity: float, x: int = 10, y: int = 5) -> GlassScene:
    grid = np.zeros((11, 20))
    grid[y, x] = reflectivity
    return GlassScene(grid, 0.1)


def rate(scene: GlassScene, sensor: GlassSensor, pose: Pose2 = POSE, n: int = 4000) -> float:
    """How many beams come back."""
    rng = np.random.default_rng(1)
    return float(np.mean([np.isfinite(sensor.scan(scene, pose, rng).ranges[0]) for _ in range(n)]))


def test_the_scene() -> None:
    for seed in range(20):
        scene = glass_scene(seed)
        assert set(np.unique(scene.reflectivity)) == {0.0, 0.15, 0.3, 0.6, 1.0}
        ny, nx = scene.reflectivity.shape
        for pose in glass_path(60, seed):
            x, y = np.floor(pose.translation / scene.resolution).astype(int)
            assert 0 < x < nx - 1
            assert 0 < y < ny - 1
            assert not scene.surface[y - 2 : y + 3, x - 2 : x + 3].any()
    again = glass_scene(3)
    np.testing.assert_array_equal(again.reflectivity, glass_scene(3).reflectivity)
    assert (again.reflectivity != glass_scene(4).reflectivity).any()


def test_a_ray_returns_from_half_way_through_the_cell() -> None:
    scene = one_cell(1.0)
    assert RAY.scan(scene, POSE, np.random.default_rng(0)).ranges[0] == pytest.approx(1.0)
    # Aslant: in through the left side at y = 0.53, out through the right one at 0.56.
    pose = Pose2(0.0, 0.53 - 0.3, math.atan2(0.03, 0.1))
    got = RAY.scan(scene, pose, np.random.default_rng(0)).ranges[0]
    assert got == pytest.approx(math.hypot(1.05, 0.315))
    assert RAY.scan(scene, Pose2(0.05, 0.65, 0.0), np.random.default_rng(0)).ranges[0] == np.inf
    assert RAY.scan(scene, Pose2(1.55, 0.55, 0.0), np.random.default_rng(0)).ranges[0] == np.inf


def test_each_beam_draws_anew() -> None:
    assert rate(one_cell(0.3), RAY) == pytest.approx(0.3, abs=5 * math.sqrt(0.21 / 4000))
    # The nearer one first, and what passes it may meet the other.
    scene = one_cell(0.3)
    scene.reflectivity[5, 14] = 0.6
    rng = np.random.default_rng(2)
    got = np.array([RAY.scan(scene, POSE, rng).ranges[0] for _ in range(4000)])
    for distance, chance in ((1.0, 0.3), (1.4, 0.7 * 0.6), (np.inf, 0.7 * 0.4)):
        assert np.mean(np.isclose(got, distance)) == pytest.approx(chance, abs=0.04)


@pytest.mark.parametrize("turn", [0.0, 0.1, 0.15, 0.3])
def test_a_cone_meets_a_cell_as_much_as_it_overlaps(turn: float) -> None:
    sensor = dataclasses.replace(RAY, cone_deg=15.0)
    pose = Pose2(0.05, 0.55, turn)
    share = plane_fraction((0.5, 5.5), turn, math.radians(7.5), (10, 5))
    want = 0.6 * share
    assert rate(one_cell(0.6), sensor, pose) == pytest.approx(want, abs=0.04)
    assert share > 0 or turn == 0.3
    # From half way along a path through the cell, whichever it is.
    ranges = [
        sensor.scan(one_cell(1.0), pose, np.random.default_rng(s)).ranges[0] for s in range(50)
    ]
    finite = np.array(ranges)[np.isfinite(ranges)]
    assert ((finite > 0.95) & (finite < 1.06)).all()


def test_readings() -> None:
    wall = GlassScene(np.ones((1, 1)), 0.1)
    rng = np.random.default_rng(0)
    sensor = dataclasses.replace(RAY, sigma=0.03)
    pose = Pose2(-1.0, 0.05, 0.0)
    got = np.array([sensor.scan(wall, pose, rng).ranges[0] for _ in range(4000)])
    assert got.mean() == pytest.approx(1.05, abs=0.003)
    assert got.std() == pytest.approx(0.03, rel=0.06)
    short = dataclasses.replace(RAY, range_max=1.05)
    assert short.scan(wall, pose, rng).ranges[0] == np.inf
    scan = GlassSensor.sonar().scan(glass_scene(), glass_path()[0], rng, stamp_ns=5)
    assert scan.ranges.shape == (24,)
    assert scan.stamp_ns == 5
    same = [
        GlassSensor.lidar().scan(glass_scene(), glass_path()[3], np.random.default_rng(9)).ranges
        for _ in range(2)
    ]
    np.testing.assert_array_equal(same[0], same[1])


def test_bad_input() -> None:
    for field, value, text in (
        ("beam_count", 0, "beam_count is 1 or more"),
        ("cone_deg", 91.0, "between 0 and 90"),
        ("range_max", 0.0, "range_max"),
        ("sigma", -1.0, "sigma"),
    ):
        with pytest.raises(ConfigError, match=text):
            dataclasses.replace(RAY, **{field: value})  # type: ignore[arg-type]
    with pytest.raises(InputError, match="stands in a surface"):
        RAY.scan(one_cell(0.3), Pose2(1.05, 0.55, 0.0), np.random.default_rng(0))
    with pytest.raises(InputError, match="not finite"):
        RAY.scan(one_cell(0.3), Pose2(math.nan, 0.0, 0.0), np.random.default_rng(0))
    with pytest.raises(InputError, match="between 0 and 1"):
        GlassScene(np.full((2, 2), 1.5), 0.1)
    with pytest.raises(InputError, match="positive resolution"):
        GlassScene(np.zeros((2, 2)), 0.0)
    with pytest.raises(ConfigError, match="pose_count"):
        glass_path(0)
