# SPDX-License-Identifier: Apache-2.0
"""Poses at many times, and beams that start at as many places.

A LIDAR asks for a pose for each of 1,024 to 130,000 beams of a scan, ten times a second: the
readable version, one time after the other in Python, is `Trajectory.at`.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing

__all__ = ["interpolate_poses", "turn_vectors"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@borrowing
def interpolate_poses(
    stamps: IntArray,
    positions: FloatArray,
    rotations: FloatArray,
    times: IntArray,
    tolerance: int,
    found_positions: FloatArray,
    found_rotations: FloatArray,
    known: npt.NDArray[np.bool_],
) -> None:
    """The pose at each of many times: between two poses as `Trajectory.at` has it.

    Where neighbours are the same bits, so is what lies between them: a robot that stands still has
    one pose.

    Args:
        stamps: of the poses [ns], never falling, shape (n,).
        positions: shape (n, 3).
        rotations: shape (n, 3, 3).
        times: shape (m,), in any order; fastest where neighbours are close.
        tolerance: how far the nearest pose may be from a time [ns].
        found_positions: takes the positions, shape (m, 3).
        found_rotations: takes the rotations, shape (m, 3, 3).
        known: takes False where a time lies before the first pose, after the last, in a gap, or at
            a stamp that has two different poses, shape (m,).
    """
    count = stamps.shape[0]
    row, described = 0, -1
    x, y, z, w, sine = 0.0, 0.0, 0.0, 1.0, 0.0
    for i in range(times.shape[0]):
        time = times[i]
        known[i] = False
        if time < stamps[0] or time > stamps[count - 1]:
            continue
        row = _last_until(stamps, time, row)
        if stamps[row] == time:
            known[i] = row == 0 or stamps[row - 1] != time or _same(positions, rotations, row - 1)
            _copy(positions, rotations, row, found_positions, found_rotations, i)
            continue
        # Differences modulo 2^64, which hold those of any two stamps.
        gone = np.uint64(time) - np.uint64(stamps[row])
        left = np.uint64(stamps[row + 1]) - np.uint64(time)
        if min(gone, left) > np.uint64(tolerance):
            continue
        known[i] = True
        fraction = float(gone) / float(np.uint64(stamps[row + 1]) - np.uint64(stamps[row]))
        for axis in range(3):
            start, end = positions[row, axis], positions[row + 1, axis]
            found_positions[i, axis] = start + fraction * (end - start)
        if described != row:
            described = row
            x, y, z, w = 0.0, 0.0, 0.0, 1.0
            if not _same_rotation(rotations, row):
                x, y, z, w = _turn_between(rotations, row)
            sine = math.sqrt(x * x + y * y + z * z)
        if sine == 0.0:
            for a in range(3):
                for b in range(3):
                    found_rotations[i, a, b] = rotations[row, a, b]
            continue
        # q and -q are one rotation: with w >= 0 the angle is at most pi.
        angle = 2.0 * math.atan2(sine, abs(w)) * math.copysign(fraction, w)
        half = math.sin(angle / 2) / sine
        _turn(
            rotations, row, x * half, y * half, z * half, math.cos(angle / 2), found_rotations, i
        )  # fmt: skip


@borrowing
def _last_until(stamps: IntArray, time: int, near: int) -> int:
    """The last stamp that is not after a time, looked for from one on."""
    last = stamps.shape[0] - 1
    if stamps[near] <= time:
        if near == last or time < stamps[near + 1]:
            return near
        if near + 1 == last or time < stamps[near + 2]:
            return near + 1
    low, high = 0, last + 1  # stamps[low] <= time, and not stamps[high]
    while high - low > 1:
        middle = (low + high) // 2
        if stamps[middle] <= time:
            low = middle
        else:
            high = middle
    return low


@borrowing
def _same(positions: FloatArray, rotations: FloatArray, row: int) -> bool:
    """Whether a pose and the next one are the same bits."""
    same = _same_rotation(rotations, row)
    for axis in range(3):
        same &= positions[row, axis] == positions[row + 1, axis]
    return same


@borrowing
def _same_rotation(rotations: FloatArray, row: int) -> bool:
    same = True
    for a in range(3):
        for b in range(3):
            same &= rotations[row, a, b] == rotations[row + 1, a, b]
    return same


@borrowing
def _copy(
    positions: FloatArray,
    rotations: FloatArray,
    row: int,
    found_positions: FloatArray,
    found_rotations: FloatArray,
    i: int,
) -> None:
    for a in range(3):
        found_positions[i, a] = positions[row, a]
        for b in range(3):
            found_rotations[i, a, b] = rotations[row, a, b]


@borrowing
def _between(rotations: FloatArray, row: int, a: int, b: int) -> float:
    """An element of the rotation from one pose to the next: of the transpose times the next."""
    total = rotations[row, 0, a] * rotations[row + 1, 0, b]
    total = total + rotations[row, 1, a] * rotations[row + 1, 1, b]
    return total + rotations[row, 2, a] * rotations[row + 1, 2, b]


@borrowing
def _turn_between(rotations: FloatArray, row: int) -> tuple[float, float, float, float]:
    """The unit quaternion from one pose to the next, by its largest component (Shepperd, 1978)."""
    m00 = _between(rotations, row, 0, 0)
    m01 = _between(rotations, row, 0, 1)
    m02 = _between(rotations, row, 0, 2)
    m10 = _between(rotations, row, 1, 0)
    m11 = _between(rotations, row, 1, 1)
    m12 = _between(rotations, row, 1, 2)
    m20 = _between(rotations, row, 2, 0)
    m21 = _between(rotations, row, 2, 1)
    m22 = _between(rotations, row, 2, 2)
    trace = m00 + m11 + m22
    if trace >= max(m00, m11, m22):
        x, y, z, w = m21 - m12, m02 - m20, m10 - m01, 1.0 + trace
    elif m00 >= max(m11, m22):
        x, y, z, w = 1.0 + m00 - m11 - m22, m10 + m01, m20 + m02, m21 - m12
    elif m11 >= m22:
        x, y, z, w = m10 + m01, 1.0 + m11 - m22 - m00, m21 + m12, m02 - m20
    else:
        x, y, z, w = m20 + m02, m21 + m12, 1.0 + m22 - m00 - m11, m10 - m01
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    return x / norm, y / norm, z / norm, w / norm


@borrowing
def _turn(
    rotations: FloatArray,
    row: int,
    x: float,
    y: float,
    z: float,
    w: float,
    found: FloatArray,
    i: int,
) -> None:
    """A pose's rotation, turned on by a unit quaternion."""
    t00, t01, t02 = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    t10, t11, t12 = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    t20, t21, t22 = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    for a in range(3):
        r0, r1, r2 = rotations[row, a, 0], rotations[row, a, 1], rotations[row, a, 2]
        found[i, a, 0] = r0 * t00 + r1 * t10 + r2 * t20
        found[i, a, 1] = r0 * t01 + r1 * t11 + r2 * t21
        found[i, a, 2] = r0 * t02 + r1 * t12 + r2 * t22


@borrowing
def turn_vectors(
    rotations: FloatArray,
    whose: IntArray,
    order: IntArray,
    vectors: FloatArray,
    turned: FloatArray,
) -> None:
    """Turn each vector by the rotation of its time.

    Args:
        rotations: shape (times, d, d).
        whose: the time of each vector that comes out, shape (m,).
        order: which vector that is, shape (m,).
        vectors: shape (n, d).
        turned: takes them, shape (m, d).
    """
    d = vectors.shape[1]
    for i in range(order.shape[0]):
        time, beam = whose[i], order[i]
        for a in range(d):
            total = rotations[time, a, 0] * vectors[beam, 0]
            for b in range(1, d):
                total = total + rotations[time, a, b] * vectors[beam, b]
            turned[i, a] = total
