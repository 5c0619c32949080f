# SPDX-License-Identifier: Apache-2.0
"""Scans in the plane of the map: whether they lie in it, and how they look from above."""

from __future__ import annotations

import math

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.poses.pose import Pose2, Pose3

__all__ = ["LEANS", "in_the_plane", "lean_of", "lies_flat"]

# A laser whose plane leans by more than this sees other walls than a map of the plane has.
LEANS = math.radians(3.0)


def lies_flat(shape: str, map_from_sensor: Pose3) -> bool:
    """Whether a scan lies in the plane of the map, upright or overhead.

    Args:
        shape: of the scan, see `Glance`.
        map_from_sensor: where its sensor was.
    """
    return shape in ("fan", "cone") and lean_of(shape, map_from_sensor) <= math.sin(LEANS)


def lean_of(shape: str, map_from_sensor: Pose3) -> float:
    """The sine of the angle by which a scan leans out of the plane of the map."""
    turned = map_from_sensor.rotation
    if shape == "cone":  # whatever way up it is
        return abs(float(turned[2, 0]))
    return math.hypot(float(turned[2, 0]), float(turned[2, 1]))


def in_the_plane(pose: Pose3, directions: FloatArray) -> tuple[Pose2, FloatArray]:
    """A level scan seen from above; that of a laser that hangs upside down runs the other way."""
    x, y, _ = pose.translation.tolist()
    yaw = math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])
    flat = directions[:, :2]
    if pose.rotation[2, 2] < 0.0:
        flat = flat * np.array([1.0, -1.0])
    return Pose2(x, y, yaw), flat
