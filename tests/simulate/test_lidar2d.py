# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose2
from oddsmap.simulate import Disc, FloorPlan, Lidar2D, Rectangle, walls_around

# A ring of beams in the middle of a round room would be the same range everywhere: a disc from
# within is just that, were the sensor not inside of it. So: a wall, and a fan too narrow to matter.
WALL = FloorPlan([Rectangle(5.0, -50.0, 6.0, 50.0)])
NARROW = Lidar2D(beam_count=40_000, angle_min=0.0, angle_step=1e-9, range_max=10.0, sigma=0.02)
ORIGIN = Pose2(0.0, 0.0, 0.0)


def ranges(lidar: Lidar2D, seed: int = 1) -> npt.NDArray[np.float64]:
    return lidar.scan(WALL, ORIGIN, np.random.default_rng(seed)).ranges


def test_exact_without_noise() -> None:
    plan = FloorPlan([*walls_around(Rectangle(-2.0, -1.0, 4.0, 3.0), 0.2), Disc(2.0, 1.0, 0.5)])
    lidar = Lidar2D(beam_count=4, angle_min=0.0, angle_step=math.pi / 2, sigma=0.0)
    pose = Pose2(0.0, 1.0, math.pi / 2)
    scan = lidar.scan(plan, pose, np.random.default_rng(0), stamp_ns=7)
    np.testing.assert_allclose(scan.ranges, [2.0, 2.0, 2.0, 1.5], atol=1e-12)
    ends = pose.transform(scan.directions * scan.ranges[:, None])
    np.testing.assert_allclose(ends, [(0, 3), (-2, 1), (0, -1), (1.5, 1)], atol=1e-12)
    assert scan.map_from_sensor is pose
    assert scan.stamp_ns == 7


def test_the_fan() -> None:
    lidar = Lidar2D(beam_count=5, angle_min=-math.pi / 2, angle_step=math.pi / 4)
    angles = np.degrees(np.arctan2(lidar.directions[:, 1], lidar.directions[:, 0]))
    np.testing.assert_allclose(angles, [-90, -45, 0, 45, 90])
    assert not lidar.directions.flags.writeable
    assert Lidar2D().directions.shape == (180, 2)


def test_noise_is_gaussian_with_sigma() -> None:
    errors = ranges(NARROW) - 5.0
    # Five standard deviations of the estimate itself.
    assert abs(errors.mean()) < 5 * 0.02 / math.sqrt(40_000)
    assert abs(errors.std() / 0.02 - 1) < 5 / math.sqrt(2 * 40_000)
    assert abs(np.mean(np.abs(errors) < 0.02) - 0.6827) < 5 * math.sqrt(0.22 / 40_000)


def test_rates_of_dropouts_and_random_readings() -> None:
    lidar = dataclasses.replace(NARROW, p_dropout=0.1, p_random=0.2)
    got = ranges(lidar)
    assert abs(np.isinf(got).mean() - 0.1) < 5 * math.sqrt(0.1 * 0.9 / 40_000)
    # 0.2 m around the wall hold ten sigma, and 0.4 m of the 10 m that random readings go over.
    strange = got[np.isfinite(got) & (np.abs(got - 5.0) > 0.2)]
    expected = 0.2 * 0.96
    assert abs(len(strange) / 40_000 - expected) < 5 * math.sqrt(expected * (1 - expected) / 40_000)
    assert 0 < strange.min() < 0.01
    assert 9.99 < strange.max() < 10.0
    counts, _ = np.histogram(strange, bins=[0, 2.4, 4.8, 5.2, 7.6, 10.0])
    np.testing.assert_allclose(counts[[0, 1, 3, 4]], len(strange) / 4, rtol=0.06)


def test_probability_one() -> None:
    assert np.isinf(ranges(dataclasses.replace(NARROW, p_dropout=1.0))).all()
    assert np.isfinite(ranges(dataclasses.replace(NARROW, p_random=1.0))).all()


def test_a_probability_changes_only_the_beams_that_it_takes() -> None:
    plain, faulty = ranges(NARROW), ranges(dataclasses.replace(NARROW, p_dropout=0.1))
    assert np.array_equal(faulty[np.isfinite(faulty)], plain[np.isfinite(faulty)])


def test_beyond_range_max_is_no_return_and_no_finite_reading_reaches_it() -> None:
    assert np.isinf(ranges(dataclasses.replace(NARROW, range_max=4.999, sigma=0.0))).all()
    assert np.isinf(ranges(dataclasses.replace(NARROW, range_max=5.0, sigma=0.0))).all()
    near_limit = ranges(dataclasses.replace(NARROW, range_max=5.01, p_random=0.1))
    assert near_limit[np.isfinite(near_limit)].max() < 5.01
    # P(noise >= half a sigma) of the 90 % that are not random.
    expected = 0.9 * 0.30854
    assert abs(np.isinf(near_limit).mean() - expected) < 5 * math.sqrt(0.21 / 40_000)


def test_ranges_stay_positive_in_front_of_a_wall() -> None:
    close = NARROW.scan(WALL, Pose2(4.995, 0.0, 0.0), np.random.default_rng(3)).ranges
    assert close.min() == 1e-3


def test_the_same_seed_gives_the_same_scans() -> None:
    lidar = Lidar2D(p_dropout=0.05, p_random=0.05)
    a, b = np.random.default_rng(5), np.random.default_rng(5)
    for x in (0.0, 1.0, 2.0):
        pose = Pose2(x, 0.0, 0.3)
        first, second = lidar.scan(WALL, pose, a), lidar.scan(WALL, pose, b)
        assert np.array_equal(first.ranges, second.ranges)
        assert first.directions is second.directions
    assert not np.array_equal(ranges(NARROW, 1), ranges(NARROW, 2))


@pytest.mark.parametrize(
    "change",
    [
        {"beam_count": 0},
        {"angle_min": math.nan},
        {"angle_step": math.inf},
        {"range_max": 0.0},
        {"range_max": math.inf},
        {"sigma": -0.01},
        {"sigma": math.nan},
        {"p_dropout": -0.1},
        {"p_random": 1.1},
        {"p_random": math.nan},
        {"p_dropout": 0.6, "p_random": 0.6},
    ],
)
def test_a_parameter_out_of_range_is_refused(change: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=f"Lidar2D: .*{next(iter(change))}") as caught:
        Lidar2D(**change)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_a_pose_that_cannot_be_is_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match=r"\(5\.500, 0\.000\) stands inside"):
        NARROW.scan(WALL, Pose2(5.5, 0.0, 0.0), rng)
    with pytest.raises(InputError, match="not finite"):
        NARROW.scan(WALL, Pose2(math.nan, 0.0, 0.0), rng)
