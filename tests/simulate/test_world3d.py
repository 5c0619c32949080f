# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
import time

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.errors import ConfigError, InputError
from oddsmap.simulate import (
    Box,
    Cylinder,
    Ground,
    Lidar3D,
    Solid,
    World3D,
    drive3d,
    room,
    room_walk,
    town,
)
from tests.naive import world3d_oracle as oracle

FloatArray = npt.NDArray[np.float64]


def unit(vectors: npt.ArrayLike) -> FloatArray:
    v = np.asarray(vectors, np.float64).reshape(-1, 3)
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def random_world(seed: int, waves: bool) -> World3D:
    rng = np.random.default_rng(seed)
    solids: list[Solid] = []
    for _ in range(6):
        x, y = rng.uniform(-6, 6, 2).tolist()
        low, tall, a, b = rng.uniform(0.2, 3.0, 4).tolist()
        yaw = 0.0 if rng.random() < 0.5 else float(rng.uniform(-4, 4))
        solids.append(Box(x, y, a, b, low - 1.0, low - 1.0 + tall, yaw))
        x, y = rng.uniform(-6, 6, 2).tolist()
        solids.append(Cylinder(x, y, a / 3, low - 1.0, low + tall))
    relief = ((0.2, 0.3, 0.5, 1.0), (0.1, -0.8, 0.4, 0.2)) if waves else ()
    return World3D(solids, Ground(-0.5, relief))


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), waves=st.booleans())
def test_cast_against_the_oracle(seed: int, waves: bool) -> None:
    world = random_world(seed, waves)
    rng = np.random.default_rng(seed)
    # Some start inside a solid, some below the ground, some look along an axis.
    origin = rng.uniform((-7, -7, -1), (7, 7, 4))
    directions = unit(rng.normal(size=(40, 3)))
    directions[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    got = world.cast(origin, directions, reach=20.0)
    at = tuple(origin.tolist())
    for t, way in zip(got.tolist(), directions.tolist(), strict=True):
        near = oracle.cast(world, at, tuple(way), 1e-9, 20.0)
        far = oracle.cast(world, at, tuple(way), -1e-9, 20.0)
        assert min(near, far) - 1e-7 <= t <= max(near, far) + 1e-7


def test_cast_by_hand() -> None:
    world = World3D(
        [Box(5, 0, 2, 4, 0, 3), Cylinder(-4, 0, 1, 0, 2), Box(0, 6, 2, 2, 1, 2, math.pi / 4)],
        Ground(),
    )
    down45 = (1.0, 0.0, -1.0)
    ways = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, -1), (0, 0, 1), down45]
    got = world.cast((0, 0, 1.5), unit(ways))
    assert got[[0, 1, 4]] == pytest.approx([4.0, 3.0, 1.5])
    assert got[2] == pytest.approx(6 - math.sqrt(2))
    assert np.isinf(got[[3, 5]]).all()
    assert got[6] == pytest.approx(1.5 * math.sqrt(2))
    # Over the cylinder's rim onto its top; from within, the surface from within; below ground.
    assert world.cast((-2, 0, 3), unit((-1.5, 0, -1)))[0] == pytest.approx(math.hypot(1.5, 1))
    assert world.cast((5, 0, 1), unit((1, 0, 0)))[0] == pytest.approx(1.0)
    assert world.cast((-4, 0, 1), unit((0, 0, 1)))[0] == pytest.approx(1.0)
    assert world.cast((9, 9, -1), unit((0, 0, 1)))[0] == 0.0
    assert np.isinf(world.cast((0, 0, 1.5), unit((1, 0, 0)), reach=3.9)).all()


def test_cast_by_hand_along_faces() -> None:
    world = World3D([Box(0, 0, 2, 2, 0, 2)])
    # In the plane of a face: touched counts as met. Just outside of it: missed.
    assert world.cast((-3, 1, 1), unit((1, 0, 0)))[0] == 2.0
    assert np.isinf(world.cast((-3, 1 + 1e-9, 1), unit((1, 0, 0)))).all()
    assert world.cast((-3, 0, 2), unit((1, 0, 0)))[0] == 2.0
    assert np.isinf(world.cast((-3, 0, 2 + 1e-9), unit((1, 0, 0)))).all()


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), waves=st.booleans())
def test_contains_against_the_oracle(seed: int, waves: bool) -> None:
    world = random_world(seed, waves)
    points = np.random.default_rng(seed).uniform((-8, -8, -1), (8, 8, 4), (200, 3))
    expected = [oracle.contains(world, tuple(p)) for p in points.tolist()]
    assert world.contains(points).tolist() == expected


def test_surfaces_lie_between_inside_and_outside() -> None:
    world = town(1)
    origin = drive3d(7, ground=world.ground)[3].translation
    directions = unit(np.random.default_rng(0).normal(size=(3000, 3)))
    ranges = world.cast(origin, directions, reach=60.0)
    seen = np.isfinite(ranges)
    ends = origin + directions[seen] * ranges[seen, None]
    assert seen.mean() > 0.5
    assert not world.contains(ends - 1e-6 * directions[seen]).any()
    # Where a ray only grazes an edge, a little farther is outside again.
    assert world.contains(ends + 1e-6 * directions[seen]).mean() > 0.99


def test_the_block_size_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    world = town(2)
    directions = Lidar3D(ring_count=8, column_count=64).directions
    origin = drive3d(5, ground=world.ground)[2].translation
    whole = world.cast(origin, directions, reach=50.0)
    monkeypatch.setattr("oddsmap.simulate.world3d._BLOCK", 7)
    assert np.array_equal(world.cast(origin, directions, reach=50.0), whole)


def test_an_empty_world() -> None:
    assert np.isinf(World3D([]).cast((0, 0, 0), unit((1, 0, 0)))).all()
    assert not World3D([]).contains([(0.0, 0.0, 0.0)]).any()
    assert World3D([]).cast((0, 0, 0), np.empty((0, 3))).shape == (0,)


@pytest.mark.parametrize("seed", range(6))
def test_the_street_is_free(seed: int) -> None:
    world = town(seed)
    assert 70 < len(world.solids) < 140
    assert world.ground is not None
    poses = drive3d(200, ground=world.ground)
    origins = np.array([pose.translation for pose in poses])
    around = np.random.default_rng(seed).uniform((-1.5, -1.5, -1.5), (1.5, 1.5, 3), (50, 3))
    for offset in around:
        assert not world.contains(origins + offset).any()
    x, y, z = origins.T
    np.testing.assert_allclose(z - world.ground.height(x, y), 1.8)
    assert math.degrees(math.atan(world.ground.steepest)) < 7


def test_the_drive_is_even_and_heads_where_it_goes() -> None:
    poses = drive3d(100)
    origins = np.array([pose.translation for pose in poses])
    steps = np.roll(origins, -1, axis=0) - origins
    lengths = np.linalg.norm(steps, axis=1)
    assert lengths.min() > 1.4
    assert lengths.max() < 1.6
    for pose, step in zip(poses, unit(steps), strict=True):
        np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose.rotation) > 0
        assert pose.rotation[:, 0] @ step > 0.99
        assert pose.rotation[2, 2] > math.cos(math.radians(3))


def test_the_walk_is_free_and_its_frames_are_optical() -> None:
    world = room()
    for pose in room_walk(200):
        assert not world.contains(pose.translation[None, :]).any()
        np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose.rotation) > 0
        assert pose.rotation[2, 1] < -0.8  # y points down
        assert pose.rotation[2, 0] == 0.0  # x is level


def test_a_seed_is_a_town() -> None:
    assert town(3) == town(3)
    assert town(3) != town(4)
    assert town(3, flat=True).ground == Ground()


@pytest.mark.slow
def test_a_full_scan_takes_less_than_a_second() -> None:
    world, lidar = town(0), Lidar3D()
    started = time.process_time()
    lidar.scan(world, drive3d(1, ground=world.ground)[0], np.random.default_rng(0))
    assert time.process_time() - started < 1.0


def test_bad_input_is_refused() -> None:
    world = World3D([], Ground(0.0, ((0.1, 1.0, 0.0, 0.0),)))
    ahead = unit((1, 0, 0))
    for call, words in (
        (lambda: world.cast((0, 0), ahead, reach=1), r"origin \(3,\)"),
        (lambda: world.cast((0, 0, 1), [(1, 0)], reach=1), r"got \(3,\) and \(1, 2\)"),
        (lambda: world.cast((0, 0, math.nan), ahead, reach=1), "origin is not finite"),
        (lambda: world.cast((0, 0, 1), 2 * ahead, reach=1), "direction 0 has length 2"),
        (lambda: world.cast((0, 0, 1), ahead * math.nan, reach=1), "direction 0 has length nan"),
        (lambda: world.cast((0, 0, 1), ahead), "reach must be"),
        (lambda: world.cast((0, 0, 1), ahead, reach=0), "reach must be"),
        (lambda: world.contains([(1.0, 2.0)]), r"points \(n, 3\)"),
        (lambda: world.contains([(1.0, 2.0, math.inf)]), "not finite"),
        (lambda: Box(0, 0, 1, -1, 0, 1), "must be positive"),
        (lambda: Box(0, 0, 1, 1, 2, 1), "z_max above z_min"),
        (lambda: Box(0, 0, 1, 1, 0, math.inf), "finite"),
        (lambda: Cylinder(0, 0, 0, 0, 1), "radius must be positive"),
        (lambda: Cylinder(math.nan, 0, 1, 0, 1), "finite"),
        (lambda: Ground(0.0, ((1.0, 1.0, 1.0, 0.0),)), "slope may be 1.41"),
        (lambda: Ground(math.nan), "finite"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            call()
        assert "\n" not in str(caught.value)
    for name, count, height in (("drive3d", 0, 1.8), ("drive3d", 1, 0.0), ("room_walk", 0, 1.0)):
        with pytest.raises(ConfigError, match=f"{name}: .*at least 1"):
            room_walk(count) if name == "room_walk" else drive3d(count, height=height)
