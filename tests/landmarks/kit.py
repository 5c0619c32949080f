# SPDX-License-Identifier: Apache-2.0
"""Worlds of landmarks, and a sensor that drives around in them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from oddsmap.landmarks import Observations
from oddsmap.landmarks.observations import Kind
from oddsmap.poses.pose import Pose2

FloatArray = npt.NDArray[np.float64]

SIGMA_RANGE = 0.1
SIGMA_BEARING = math.radians(2.0)
SIGMA_XY = 0.1


def circle(count: int, radius: float = 12.0) -> list[Pose2]:
    """Poses on a circle, looking along it."""
    angles = [2.0 * math.pi * k / count for k in range(count)]
    return [Pose2(radius * math.cos(a), radius * math.sin(a), a + 0.5 * math.pi) for a in angles]


def world(rng: np.random.Generator, count: int, apart: float, side: float = 17.0) -> FloatArray:
    """Positions in a square about the origin, none nearer than `apart` to another."""
    points: list[FloatArray] = []
    while len(points) < count:
        point = rng.uniform(-side, side, 2)
        if all(math.dist(point, other) > apart for other in points):
            points.append(point)
    return np.array(points)


def observe(
    kind: Kind,
    pose: Pose2,
    points: FloatArray,
    rng: np.random.Generator,
    ids: npt.ArrayLike | None = None,
    noise: float = 1.0,
) -> Observations:
    """Noisy observations of points in the map frame; `noise` 0: exact readings."""
    n = len(points)
    relative = pose.inverse().transform(points)
    ranges = np.hypot(relative[:, 0], relative[:, 1])
    bearings = np.arctan2(relative[:, 1], relative[:, 0])
    ranges = ranges + noise * rng.normal(0.0, SIGMA_RANGE, n)
    bearings = bearings + noise * rng.normal(0.0, SIGMA_BEARING, n)
    relative = relative + noise * rng.normal(0.0, SIGMA_XY, (n, 2))
    if kind == "range-bearing":
        return Observations.range_bearing(
            pose,
            ranges,
            bearings,
            sigma_range=SIGMA_RANGE,
            sigma_bearing=SIGMA_BEARING,
            ids=ids,
        )
    if kind == "bearing":
        return Observations.bearing(pose, bearings, sigma_bearing=SIGMA_BEARING, ids=ids)
    return Observations.position(pose, relative, sigma_xy=SIGMA_XY, ids=ids)


def drive(
    kind: Kind, marks: FloatArray, rng: np.random.Generator, scans: int
) -> Iterator[Observations]:
    """Scans from a circle, all landmarks in each, with ids."""
    for pose in circle(scans):
        yield observe(kind, pose, marks, rng, np.arange(len(marks)))


def cluttered_drive(
    kind: Kind, marks: FloatArray, rng: np.random.Generator, scans: int, clutter: float
) -> Iterator[Observations]:
    """Scans without ids: a reach of 15 m, one landmark in ten missed, false readings among them."""
    reach = 15.0
    for pose in circle(scans):
        away = np.hypot(*(marks - pose.translation).T)
        seen = marks[(away < reach) & (rng.random(len(marks)) < 0.9)]
        count = rng.poisson(clutter)
        radius, angle = reach * np.sqrt(rng.random(count)), rng.uniform(-np.pi, np.pi, count)
        false = pose.translation + np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)
        order = rng.permutation(len(seen) + count)
        yield observe(kind, pose, np.concatenate([seen, false])[order], rng)
