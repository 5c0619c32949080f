# SPDX-License-Identifier: Apache-2.0
"""Log likelihood of one scan from each of many poses: beams of all of them in one loop."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined

__all__ = ["BeamMixture", "beam_log_likelihoods", "field_log_likelihoods", "place_beams"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

CERTAIN = 9.0
"""Beyond so many standard deviations a double has nothing of the normal distribution left."""


class BeamMixture(NamedTuple):
    """The beam model's weights and its parameters; lengths in metres."""

    z_hit: float
    z_short: float
    z_max: float
    z_rand: float
    sigma_hit: float
    lambda_short: float
    range_max: float


@borrowing
def field_log_likelihoods(
    squared: npt.NDArray[Any],
    lo: IntArray,
    shape: IntArray,
    in_space: bool,
    log_p: FloatArray,
    resolution: float,
    rotations: FloatArray,
    positions: FloatArray,
    ends: FloatArray,
    out: FloatArray,
) -> None:
    """Sum over beams what the cell that holds the end of each says.

    Args:
        squared: squared distance of each cell of a box to the nearest occupied one [cells],
            x fastest, flat, in 2 bytes where they fit; one that is too far has the last row of
            `log_p`.
        lo: first cell of the box, shape (3,), x first.
        shape: cells along each axis, shape (3,).
        in_space: False: the map is 2D, z is not looked at, which is 1.2 times as fast.
        log_p: log p(z) by squared distance.
        resolution: side of a cell [m].
        rotations: map_from_sensor of each pose, shape (n, 3, 3).
        positions: likewise [m], shape (n, 3).
        ends: of the beams in the sensor frame [m], shape (m, 3).
        out: filled, shape (n,).
    """
    far = log_p.shape[0] - 1
    for i in range(out.shape[0]):
        r, t = rotations[i], positions[i]
        total = 0.0
        for j in range(ends.shape[0]):
            px, py, pz = ends[j, 0], ends[j, 1], ends[j, 2]
            x = np.floor((r[0, 0] * px + r[0, 1] * py + r[0, 2] * pz + t[0]) / resolution) - lo[0]
            y = np.floor((r[1, 0] * px + r[1, 1] * py + r[1, 2] * pz + t[1]) / resolution) - lo[1]
            z = 0.0
            if in_space:
                z = r[2, 0] * px + r[2, 1] * py + r[2, 2] * pz + t[2]
                z = np.floor(z / resolution) - lo[2]
            row = far
            if (
                (x >= 0.0) & (y >= 0.0) & (z >= 0.0)
                & (x < shape[0]) & (y < shape[1]) & (z < shape[2])
            ):  # fmt: skip
                row = squared[(np.int64(z) * shape[1] + np.int64(y)) * shape[0] + np.int64(x)]
            total += log_p[row]
        out[i] = total


@borrowing
def place_beams(
    rotations: FloatArray,
    positions: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    resolution: float,
    starts: FloatArray,
    ways: FloatArray,
) -> None:
    """The beams of a scan as rays from each pose.

    Args:
        rotations: map_from_sensor of each pose, shape (n, d, d).
        positions: likewise [m], shape (n, d).
        origins: where beams start in the sensor frame [m], shape (m, d).
        directions: unit vectors in the sensor frame, shape (m, d).
        resolution: side of a cell [m].
        starts: filled [cells], shape (n m, d), the beams of the first pose first.
        ways: filled, likewise.
    """
    d, beams = directions.shape[1], directions.shape[0]
    for i in range(positions.shape[0]):
        for j in range(beams):
            for a in range(d):
                start, way = 0.0, 0.0
                for b in range(d):
                    start += rotations[i, a, b] * origins[j, b]
                    way += rotations[i, a, b] * directions[j, b]
                starts[i * beams + j, a] = (start + positions[i, a]) / resolution
                ways[i * beams + j, a] = way


@inlined
def _below(x: float) -> float:
    # The normal distribution's function.
    return 0.5 * math.erfc(-x * math.sqrt(0.5))


@borrowing
def _beam_likelihood(reading: float, expected: float, model: BeamMixture) -> float:
    off = (reading - expected) / model.sigma_hit
    inside = 1.0
    low, high = expected / model.sigma_hit, (model.range_max - expected) / model.sigma_hit
    if min(low, high) < CERTAIN:
        inside = _below(high) - _below(-low)
    hit = math.exp(-0.5 * off * off) / (model.sigma_hit * math.sqrt(2.0 * math.pi) * inside)
    p = model.z_hit * hit
    if reading <= expected and expected > 0.0:
        rate = model.lambda_short
        p += model.z_short * rate * math.exp(-rate * reading) / -math.expm1(-rate * expected)
    if reading >= model.range_max:
        p += model.z_max
    else:
        p += model.z_rand / model.range_max
    return p


@borrowing
def beam_log_likelihoods(
    readings: FloatArray,
    expected: FloatArray,
    resolution: float,
    model: BeamMixture,
    out: FloatArray,
) -> None:
    """Sum the log of the beam model over the beams of each pose.

    Args:
        readings: of the beams [m], range_max for a no-return, shape (m,).
        expected: how far the ray of each beam goes [cells], infinity where it meets nothing,
            shape (n m,).
        resolution: side of a cell [m].
        model: the mixture.
        out: filled, shape (n,).
    """
    beams = readings.shape[0]
    for i in range(out.shape[0]):
        total = 0.0
        for j in range(beams):
            there = min(expected[i * beams + j] * resolution, model.range_max)
            total += math.log(_beam_likelihood(readings[j], there, model))
        out[i] = total
