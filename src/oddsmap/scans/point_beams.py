# SPDX-License-Identifier: Apache-2.0
"""Points as the ends of beams from a sensor."""

from __future__ import annotations

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.poses.pose import Pose, Pose3
from oddsmap.poses.product import inverse, product

__all__ = ["beams_to", "in_sensor_frame"]

# Whose square is well within what doubles hold.
_SAFE = 1e-140


def in_sensor_frame(pose: Pose, points: FloatArray) -> FloatArray:
    """Points of the map frame, shape (n, d), so that the pose takes them back to where they are."""
    # The inverse itself where there is one: a matrix of few digits is no exact rotation.
    turn = pose.rotation.T
    if isinstance(pose, Pose3) and pose.is_finite:
        back = inverse(pose.rotation)
        turn = turn if back is None else back
    with np.errstate(invalid="ignore", over="ignore"):
        return product(points - pose.translation, turn.T)


def beams_to(ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions and ranges of points [m], shape (n, d)."""
    with np.errstate(invalid="ignore", over="ignore", under="ignore"):
        squares = ends[:, 0] ** 2
        for k in range(1, ends.shape[1]):
            squares = squares + ends[:, k] ** 2
        ranges = np.sqrt(squares)
        # Squares overflow and underflow half way to the ends of what doubles hold.
        odd = ~((ranges > _SAFE) & (ranges < 1 / _SAFE))
        if odd.any():
            ranges[odd] = np.hypot(ends[odd, 0], ends[odd, 1])
            if ends.shape[1] == 3:
                ranges[odd] = np.hypot(ranges[odd], ends[odd, 2])
    ranges[~np.isfinite(ranges)] = np.nan
    unusable = ~(ranges > 0)
    directions = ends / np.where(unusable, 1.0, ranges)[:, None]
    directions[unusable] = np.eye(ends.shape[1])[0]
    return directions, ranges
