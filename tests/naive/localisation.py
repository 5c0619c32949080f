# SPDX-License-Identifier: Apache-2.0
"""Likelihoods of one scan from one pose: one beam, one occupied cell at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from tests.naive.rays import Cell, first_met

__all__ = ["beam_model", "end_of", "likelihood_field"]

Pose = tuple[Sequence[Sequence[float]], Sequence[float]]
"""Rotation and position [m]."""


def turned(rotation: Sequence[Sequence[float]], vector: Sequence[float]) -> list[float]:
    return [sum(r * v for r, v in zip(row, vector, strict=True)) for row in rotation]


def end_of(pose: Pose, way: Sequence[float], reading: float) -> list[float]:
    """Where a beam ends [m]."""
    there = turned(pose[0], [w * reading for w in way])
    return [a + b for a, b in zip(there, pose[1], strict=True)]


def likelihood_field(
    occupied: Sequence[Cell],
    resolution: float,
    pose: Pose,
    beams: Sequence[tuple[Sequence[float], float]],
    *,
    range_max: float,
    sigma_hit: float,
    z_hit: float,
    z_rand: float,
    max_distance: float,
) -> float:
    """Sum of log p over the beams that returned: direction and reading [m] each."""
    total = 0.0
    for way, reading in beams:
        if not 0.0 <= reading < range_max:
            continue
        cell = [math.floor(x / resolution) for x in end_of(pose, way, reading)]
        distances = [resolution * math.dist(cell, other) for other in occupied]
        d = min([max_distance, *distances])
        total += math.log(z_hit * math.exp(-d * d / (2 * sigma_hit**2)) + z_rand / range_max)
    return total


def normal_mass(low: float, high: float, mean: float, sigma: float) -> float:
    def below(x: float) -> float:
        return 0.5 * (1.0 + math.erf((x - mean) / (sigma * math.sqrt(2.0))))

    return below(high) - below(low)


def beam_model(
    states: Mapping[Cell, int],
    stop: int,
    resolution: float,
    pose: Pose,
    beams: Sequence[tuple[Sequence[float], float]],
    *,
    range_max: float,
    sigma_hit: float,
    lambda_short: float,
    z_hit: float,
    z_short: float,
    z_max: float,
    z_rand: float,
) -> float:
    """Sum of log p over the beams that say something, as in table 6.1 of Probabilistic Robotics."""
    total = 0.0
    for way, reading in beams:
        if not reading >= 0.0:
            continue
        z = min(reading, range_max)
        start = [x / resolution for x in pose[1]]
        met = first_met(states, {stop}, start, turned(pose[0], way), range_max / resolution)
        there = range_max if met is None else float(met[0]) * resolution
        density = math.exp(-((z - there) ** 2) / (2 * sigma_hit**2))
        density /= sigma_hit * math.sqrt(2 * math.pi)
        p = z_hit * density / normal_mass(0.0, range_max, there, sigma_hit)
        if z <= there and there > 0.0:
            within = 1.0 - math.exp(-lambda_short * there)
            p += z_short * lambda_short * math.exp(-lambda_short * z) / within
        p += z_max if z == range_max else z_rand / range_max
        total += math.log(p)
    return total
