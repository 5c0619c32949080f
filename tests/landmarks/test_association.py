# SPDX-License-Identifier: Apache-2.0
"""Observations without ids: the gate, who belongs to whom, and whole worlds recovered."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from oddsmap.landmarks import LandmarkMap, Observations
from oddsmap.landmarks.association import (
    chi_square_quantile,
    mutual_nearest,
    squared_mahalanobis,
)
from oddsmap.landmarks.observations import Kind
from oddsmap.poses.pose import Pose2
from tests.landmarks.kit import cluttered_drive, observe, world
from tests.naive.landmarks import squared_mahalanobis_of

ORIGIN = Pose2(0.0, 0.0, 0.0)


def positions(*points: tuple[float, float], sigma: float = 0.1) -> Observations:
    return Observations.position(ORIGIN, points, sigma_xy=sigma)


@pytest.mark.parametrize("degrees", [1, 2, 3])
def test_quantile(degrees: int) -> None:
    for p in (0.5, 0.99, 0.999999):
        assert chi_square_quantile(p, degrees) == pytest.approx(chi2.ppf(p, degrees), rel=1e-12)


@pytest.mark.parametrize("kind", ["range-bearing", "bearing", "position"])
def test_distance(kind: Kind) -> None:
    rng = np.random.default_rng(4)
    means = rng.uniform(-9.0, 9.0, (6, 2))
    roots = rng.normal(0.0, 0.2, (6, 2, 2))
    covariances = roots @ roots.transpose(0, 2, 1) + 1e-3 * np.eye(2)
    seen = observe(kind, Pose2(0.5, -0.2, 2.8), rng.uniform(-9.0, 9.0, (5, 2)), rng)
    distance = squared_mahalanobis(seen, means, covariances)
    for row in range(5):
        for column in range(6):
            slow = squared_mahalanobis_of(seen, row, means[column], covariances[column])
            assert distance[row, column] == pytest.approx(slow, rel=1e-6)


@given(
    st.integers(0, 6).flatmap(
        lambda n: st.lists(
            st.lists(st.integers(0, 9), min_size=n, max_size=n), min_size=1, max_size=6
        )
    ),
    st.integers(0, 9),
)
def test_mutual_nearest(rows: list[list[int]], limit: int) -> None:
    distance = np.array(rows, np.float64).reshape(len(rows), len(rows[0]))
    pairs = mutual_nearest(distance, limit)
    for row, column in enumerate(pairs):
        for other in range(distance.shape[1]):
            first = other == int(np.argmin(distance[row]))
            mutual = first and row == int(np.argmin(distance[:, other]))
            assert (column == other) == (mutual and distance[row, other] <= limit)


def test_who_belongs_to_whom() -> None:
    landmarks = LandmarkMap(min_count=1)
    assert landmarks.add(positions((0.0, 0.0), (5.0, 0.0))).tolist() == [0, 1]
    # Both near landmark 0: the nearer takes it, the other is a second one; 1 goes unseen.
    assert landmarks.add(positions((0.3, 0.0), (0.1, 0.0))).tolist() == [2, 0]
    assert landmarks.skipped == {}


@pytest.mark.parametrize(("away", "expected"), [(0.42, 0), (0.44, -1), (0.73, -1), (0.76, 1)])
def test_between_the_gates(away: float, expected: int) -> None:
    """Sigma of the innovation is 0.1 sqrt(2): the gates are at 3.03 and 5.26 of it."""
    landmarks = LandmarkMap(min_count=1)
    landmarks.add(positions((5.0, 0.0)))
    assert landmarks.add(positions((5.0, away))).tolist() == [expected]
    assert landmarks.skipped["observation.ambiguous"] == (expected == -1)


def test_the_gate_is_an_option() -> None:
    for gate, expected in ((0.99, -1), (0.9999, 0)):
        landmarks = LandmarkMap(gate=gate, min_count=1)
        landmarks.add(positions((0.0, 0.0)))
        assert landmarks.add(positions((0.52, 0.0))).tolist() == [expected]


def test_tentative_landmarks_come_second() -> None:
    landmarks = LandmarkMap()
    for _ in range(3):
        landmarks.add(positions((0.0, 0.0)))
    landmarks.add(positions((0.0, 0.0), (0.32, 0.0)))  # a false reading beside it: tentative
    assert (len(landmarks.landmarks), landmarks.tentative) == (1, 1)
    # Nearer to the tentative one, yet in the gate of the landmark: it gets it.
    assert landmarks.add(positions((0.25, 0.0))).tolist() == [0]


def test_bearings_find_landmarks_but_start_none() -> None:
    landmarks = LandmarkMap(min_count=1)
    landmarks.add(positions((5.0, 0.0)))
    before = landmarks.landmarks[0].covariance
    ids = landmarks.add(Observations.bearing(ORIGIN, [0.001, 1.0], sigma_bearing=0.01))
    assert ids.tolist() == [0, -1]
    assert landmarks.skipped == {"observation.unmatched_bearing": 1}
    after = landmarks.landmarks[0].covariance
    assert after[0, 0] == pytest.approx(before[0, 0])
    assert after[1, 1] == pytest.approx(1.0 / (1.0 / before[1, 1] + 1.0 / (5.0 * 0.01) ** 2), 1e-3)
    assert (len(landmarks.landmarks), landmarks.unlocated) == (1, 0)


@pytest.mark.parametrize("kind", ["range-bearing", "position"])
def test_a_cluttered_world_is_recovered(kind: Kind) -> None:
    """30 landmarks 2.5 m apart, one false reading a scan: each is found, once, and no other."""
    errors: list[float] = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        marks = world(rng, count=30, apart=2.5)
        landmarks = LandmarkMap(min_count=5)
        for scan in cluttered_drive(kind, marks, rng, scans=80, clutter=1.0):
            landmarks.add(scan)
        found = landmarks.landmarks
        away = np.array([[np.hypot(*(mark.mean - true)) for true in marks] for mark in found])
        nearest = away.argmin(axis=1)
        assert sorted(nearest) == list(range(30))
        assert away.min(axis=1).max() < 0.3
        assert landmarks.tentative > 20  # the clutter
        truth = {mark.id: marks[i] for mark, i in zip(found, nearest, strict=True)}
        errors.extend(landmarks.nees(truth))
    low, high = chi2.ppf([0.025, 0.975], 2 * len(errors)) / len(errors)
    assert low < np.mean(errors) < high
