# SPDX-License-Identifier: Apache-2.0
"""The observations of one scan: frames, noise, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError, OddsmapError
from oddsmap.landmarks import Observations
from oddsmap.poses.pose import Pose2, Pose3

POSE = Pose2(2.0, -1.0, 0.5 * math.pi)
SPACE = Pose3(np.zeros(3), np.eye(3))


def test_positions_in_the_map_frame() -> None:
    seen = Observations.position(POSE, [[1.0, 0.0]], covariance=np.diag([4.0, 1.0]))
    points, covariances = seen.in_map()
    assert np.allclose(points, [[2.0, 0.0]])
    assert np.allclose(covariances, [np.diag([1.0, 4.0])])


def test_ranges_with_bearings_in_the_map_frame() -> None:
    """Against many samples of the noise, small enough for the first order."""
    seen = Observations.range_bearing(POSE, [5.0], [0.3], sigma_range=0.01, sigma_bearing=0.004)
    rng = np.random.default_rng(0)
    r, a = rng.normal(5.0, 0.01, 200_000), rng.normal(0.3, 0.004, 200_000)
    samples = POSE.transform(np.stack([r * np.cos(a), r * np.sin(a)], axis=1))
    points, covariances = seen.in_map()
    assert np.allclose(points[0], samples.mean(axis=0), rtol=0, atol=3e-4)
    assert np.allclose(covariances[0], np.cov(samples.T), rtol=0, atol=5e-6)


def test_a_bearing_is_no_position() -> None:
    with pytest.raises(InputError, match="no position"):
        Observations.bearing(POSE, [0.0], sigma_bearing=0.1).in_map()


def test_rows() -> None:
    seen = Observations.position(POSE, [[1.0, 0.0], [2.0, 0.0]], sigma_xy=0.1, ids=[3, 4])
    kept = seen.rows(np.array([False, True]))
    assert kept.values.tolist() == [[2.0, 0.0]]
    assert kept.ids is not None
    assert kept.ids.tolist() == [4]


@pytest.mark.parametrize(
    ("kind", "arguments", "error", "message"),
    [
        ("bearing", {"sigma_bearing": 0.0}, ConfigError, "sigma_bearing must be positive"),
        ("bearing", {"sigma_bearing": math.nan}, ConfigError, "sigma_bearing must be positive"),
        ("bearing", {"sigma_bearing": 1.0, "ids": [1, 2]}, InputError, "ids of shape"),
        ("bearing", {"sigma_bearing": 1.0, "ids": [0.5]}, InputError, "integers"),
        ("bearing", {"sigma_bearing": 1.0, "ids": [-1]}, InputError, "from 0"),
        ("bearing", {"sigma_bearing": 1.0, "bearings": [[1.0]]}, InputError, "shape"),
        (
            "bearing",
            {"sigma_bearing": 1.0, "map_from_sensor": Pose2(math.nan, 0, 0)},
            InputError,
            "not finite",
        ),
        ("bearing", {"sigma_bearing": 1.0, "map_from_sensor": SPACE}, InputError, "need a 2D pose"),
        ("position", {}, ConfigError, "one of sigma_xy"),
        ("position", {"sigma_xy": 1.0, "covariance": np.eye(2)}, ConfigError, "one of sigma_xy"),
        ("position", {"sigma_xy": 1.0, "points": [1.0, 2.0]}, InputError, "shape"),
        ("position", {"sigma_xy": 1.0, "map_from_sensor": SPACE}, InputError, r"values \(n, 3\)"),
        ("position", {"covariance": np.eye(3)}, InputError, "covariances"),
        ("position", {"covariance": [[1.0, 0.5], [0.0, 1.0]]}, InputError, "symmetric"),
        ("position", {"covariance": [[1.0, 2.0], [2.0, 1.0]]}, InputError, "definite"),
    ],
)
def test_refused(
    kind: str, arguments: dict[str, object], error: type[OddsmapError], message: str
) -> None:
    fine: dict[str, object] = {"map_from_sensor": POSE}
    fine |= {"bearings": [0.0]} if kind == "bearing" else {"points": [[0.0, 0.0]]}
    with pytest.raises(error, match=message):
        getattr(Observations, kind)(**fine | arguments)
