# SPDX-License-Identifier: Apache-2.0
"""The floor of columns, and what keeps a robot from it."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray

__all__ = ["Limits", "Verdict", "judge_columns"]

_REACH = 0.3  # how far the floor may be from the ground [m]: a kerb, a slab, a bump
_AROUND = 0.5  # the plane whose slope counts reaches this far [m]: a kerb is no slope
_LEAST = 6  # cells of it, below which there is no slope to speak of


class Verdict(IntEnum):
    """What a robot meets in a column."""

    UNKNOWN = -1
    """Nothing was seen near the ground."""
    FREE = 0
    BLOCKED = 1
    """Something is in the way between the floor and the robot's height."""
    STEP = 2
    SLOPE = 3
    DROP = 4
    UNDECIDED = 50
    """Something may be in the way."""


class Limits(NamedTuple):
    """What the robot needs."""

    height: float
    """Free space above the floor [m]."""
    step: float
    """The highest step that it climbs [m]."""
    slope: float
    """The steepest slope, as rise over way."""
    radius: float
    """Of a circle that holds it [m]."""

    @property
    def reach(self) -> float:
        """How far the floor may be from the ground [m]."""
        return max(_REACH, self.step)


def judge_columns(
    band: npt.NDArray[np.uint8],
    below: BoolArray,
    base: IntArray,
    ground: FloatArray,
    shape: tuple[int, int],
    resolution: float,
    limits: Limits,
) -> tuple[npt.NDArray[np.int8], FloatArray]:
    """Find the floor of each column and judge it.

    Args:
        band: what cells are, 0 unknown, 1 free, 2 undecided, 3 occupied, shape (layers, n).
        below: True where a free cell lies below the band, shape (n,).
        base: z index of the band's first layer, shape (n,).
        ground: height of the ground [m], shape (n,).
        shape: (ny, nx), with n = ny nx.
        resolution: side of a cell [m].
        limits: what the robot needs.

    Returns:
        Values of `Verdict`, and heights of the floor [m], NaN where none was seen; of that shape.
    """
    layers, n = band.shape
    top = (base + np.arange(1, layers + 1)[:, None]) * resolution
    near = np.abs(top - ground) <= limits.reach + 1e-9
    # Downwards, so that the highest stays.
    layer = np.full(n, -1)
    for i in range(layers):
        layer[near[i] & (band[i] == 3)] = i
    found = layer >= 0
    floor = np.where(found, (base + layer + 1) * resolution, np.nan)
    level = np.where(found, floor, ground)
    above = (top - resolution / 2 > level) & (top - resolution / 2 < level + limits.height)
    blocked = (above & (band == 3)).any(axis=0)
    # What may be no more than a step on the floor is in nobody's way.
    undecided = (above & (top > level + limits.step + 1e-9) & (band == 2)).any(axis=0)
    deep = below | ((band == 1) & (top < ground - limits.reach - 1e-9)).any(axis=0)
    seen = found | (near & (band == 1)).any(axis=0)
    verdict = np.full(n, Verdict.UNKNOWN, np.int8)
    verdict[seen] = Verdict.FREE
    verdict[seen & undecided] = Verdict.UNDECIDED
    plane, flat = floor.reshape(shape), np.where(blocked, np.nan, floor).reshape(shape)
    verdict[seen & (_slope(flat, resolution, limits) > limits.slope).ravel()] = Verdict.SLOPE
    verdict[seen & _is_step(flat, limits.step).ravel()] = Verdict.STEP
    verdict[deep & ~found] = Verdict.DROP
    verdict[blocked] = Verdict.BLOCKED
    return verdict.reshape(shape), plane


def _is_step(floor: FloatArray, step: float) -> BoolArray:
    """Where the floor is higher than that of one of the eight neighbours by more than a step."""
    ny, nx = floor.shape
    wide = np.pad(floor, 1, constant_values=np.nan)
    found = np.zeros(floor.shape, np.bool_)
    for dy in range(3):
        for dx in range(3):
            found |= floor - wide[dy : dy + ny, dx : dx + nx] > step + 1e-9
    return found


def _slope(floor: FloatArray, resolution: float, limits: Limits) -> FloatArray:
    """Slope of the plane of least squares through the floor around, 0 where too little is seen."""
    from scipy.ndimage import correlate1d

    half = max(1, math.ceil(max(_AROUND, limits.radius) / resolution))
    along, one = np.arange(-half, half + 1, dtype=np.float64), np.ones(2 * half + 1)
    seen = np.isfinite(floor)
    # Heights from the lowest: far above the origin no digits are lost.
    z = np.where(seen, floor - (floor[seen].min() if seen.any() else 0.0), 0.0)

    def total(values: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        rows = correlate1d(values, x, axis=1, mode="constant")
        return np.asarray(correlate1d(rows, y, axis=0, mode="constant"))

    w, square = seen.astype(np.float64), along * along
    n, x, y = total(w, one, one), total(w, along, one), total(w, one, along)
    h, hx, hy = total(z, one, one), total(z, along, one), total(z, one, along)
    some = np.maximum(n, 1.0)
    xx, yy = total(w, square, one) - x * x / some, total(w, one, square) - y * y / some
    xy = total(w, along, along) - x * y / some
    hx, hy = hx - h * x / some, hy - h * y / some
    area = xx * yy - xy * xy
    enough = (n >= _LEAST) & (area > 1e-6 * np.maximum(xx * yy, 1.0)) & seen
    area = np.where(enough, area, 1.0)
    slope = np.hypot(hx * yy - hy * xy, hy * xx - hx * xy) / area / resolution
    return np.where(enough, slope, 0.0)
