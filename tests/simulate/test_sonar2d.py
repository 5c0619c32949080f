# SPDX-License-Identifier: Apache-2.0
"""The ring of sonars: exact distances against rays at will, and the rates of its faults."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose2
from oddsmap.simulate.sonar2d import Sonar2D, nearest_in_cones

# One sonar 0.5 m before a wall, many times over.
WALL = np.zeros((40, 40), np.bool_)
WALL[:, 15] = True
BEFORE_IT = Pose2(1.0, 2.05, 0.0)
RINGS = 5_000


def front_readings(sonar: Sonar2D, seed: int = 0) -> np.ndarray[Any, np.dtype[np.float64]]:
    rng = np.random.default_rng(seed)
    one = dataclasses.replace(sonar, beam_count=1)
    return np.array([one.scan(WALL, 0.1, BEFORE_IT, rng).ranges[0] for _ in range(RINGS)])


@pytest.mark.parametrize("degrees", [10.0, 25.0, 180.0])
def test_nearest_points_by_many_rays(degrees: float) -> None:
    """Against 4000 rays in each cone, cast cell by cell: never nearer, and hardly farther."""
    rng = np.random.default_rng(int(degrees))
    found = 0
    for _ in range(15):
        truth = rng.random((12, 12)) < 0.08
        origin = rng.uniform(0.3, 0.9, 2)
        truth[int(origin[1] / 0.1), int(origin[0] / 0.1)] = False
        half, turn = math.radians(degrees) / 2, rng.uniform(-3, 3)
        axis = np.array([[math.cos(turn), math.sin(turn)]])
        got = nearest_in_cones(truth, 0.1, origin, axis, half, 2.0)[0]
        rays = turn + np.linspace(-half, half, 4000)
        way = np.stack([np.cos(rays), np.sin(rays)], axis=1)
        best = math.inf
        for y, x in zip(*np.nonzero(truth), strict=True):
            corner = np.array([x, y]) * 0.1 - origin
            one, other = corner / way, (corner + 0.1) / way
            enter = np.minimum(one, other).max(axis=1)
            met = (enter > 0) & (enter < np.maximum(one, other).min(axis=1))
            best = min(best, enter[met].min(initial=math.inf))
        if math.isfinite(best):
            assert best - 0.005 < got <= best + 1e-12
            found += 1
        else:
            assert math.isinf(got)
    assert found > 5


def test_the_ring_by_hand() -> None:
    truth = np.zeros((30, 30), np.bool_)
    truth[10, 20] = True  # x from 2.0 to 2.1, y from 1.0 to 1.1
    sonar = Sonar2D(beam_count=4, cone_deg=20.0, range_max=2.0, sigma=0.0)
    scan = sonar.scan(
        truth, 0.1, Pose2(1.0, 1.05, math.pi / 2), np.random.default_rng(0), stamp_ns=3
    )
    # The robot looks along y: what lies along x is in the last beam.
    np.testing.assert_allclose(scan.ranges, [np.inf, np.inf, np.inf, 1.0])
    np.testing.assert_allclose(scan.directions, [[1, 0], [0, 1], [-1, 0], [0, -1]], atol=1e-15)
    assert scan.stamp_ns == 3
    # 30 degrees beside the axis, a cone of 70: met on its side, at an angle of 35 - 30 degrees.
    aside = Pose2(1.0, 1.0, math.radians(30))
    wide = dataclasses.replace(sonar, beam_count=1, cone_deg=70.0)
    assert wide.scan(truth, 0.1, aside, np.random.default_rng(0)).ranges[0] == pytest.approx(1.0)
    narrow = dataclasses.replace(wide, cone_deg=56.0)  # from 2 degrees above the x axis
    assert narrow.scan(truth, 0.1, aside, np.random.default_rng(0)).ranges[0] == pytest.approx(
        1.0 / math.cos(math.radians(2))
    )
    assert np.isinf(
        dataclasses.replace(narrow, range_max=1.0).scan(
            truth, 0.1, aside, np.random.default_rng(0)
        ).ranges
    ).all()  # fmt: skip


def test_noise_and_faults() -> None:
    sonar = Sonar2D(range_max=2.0, sigma=0.02)
    plain = front_readings(sonar) - 0.5
    assert abs(plain.mean()) < 5 * 0.02 / math.sqrt(RINGS)
    assert abs(plain.std() / 0.02 - 1) < 5 / math.sqrt(2 * RINGS)
    faulty = front_readings(dataclasses.replace(sonar, p_random=0.2, p_dropout=0.1))
    assert abs(np.isinf(faulty).mean() - 0.1) < 5 * math.sqrt(0.09 / RINGS)
    strange = faulty[np.isfinite(faulty) & (np.abs(faulty - 0.5) > 0.1)]
    assert abs(len(strange) / RINGS - 0.2 * 0.9) < 5 * math.sqrt(0.15 / RINGS)
    assert strange.max() > 1.98
    # A faulty beam leaves the others' noise alone.
    whole = np.isfinite(faulty) & (np.abs(faulty - 0.5) <= 0.1)
    assert np.mean(faulty[whole] == plain[whole] + 0.5) > 0.95


def test_the_same_seed_gives_the_same_scan() -> None:
    sonar = Sonar2D(p_random=0.1, p_dropout=0.1)
    one, two = (sonar.scan(WALL, 0.1, BEFORE_IT, np.random.default_rng(4)) for _ in range(2))
    assert np.array_equal(one.ranges, two.ranges)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"beam_count": 0}, "beam_count"),
        ({"cone_deg": 0.0}, "cone_deg"),
        ({"cone_deg": 200.0}, "cone_deg"),
        ({"range_max": math.inf}, "range_max"),
        ({"sigma": -1.0}, "sigma"),
        ({"p_random": 0.6, "p_dropout": 0.6}, "add up to 1"),
        ({"p_dropout": math.nan}, "p_dropout"),
    ],
)
def test_a_bad_sonar(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Sonar2D(**fields)


def test_bad_input() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="stands in an occupied cell"):
        Sonar2D().scan(WALL, 0.1, Pose2(1.55, 1.0, 0.0), rng)
    with pytest.raises(InputError, match="not finite"):
        Sonar2D().scan(WALL, 0.1, Pose2(math.nan, 1.0, 0.0), rng)
    with pytest.raises(InputError, match=r"grid \(ny, nx\)"):
        Sonar2D().scan(WALL[0], 0.1, BEFORE_IT, rng)
