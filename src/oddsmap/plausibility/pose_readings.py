# SPDX-License-Identifier: Apache-2.0
"""Other things that the numbers of a pose may have meant, to compare with how they were read."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from oddsmap.poses.pose import Pose, Pose2, Pose3, quaternion_xyzw

__all__ = ["AS_READ", "W_FIRST", "PoseReading", "readings_of"]


class PoseReading(NamedTuple):
    """One way to read a pose."""

    code: str
    """Of the note that suspects it."""
    suspicion: str
    """What the log would have written, for people."""
    remedy: str
    """What to do then."""
    read: Callable[[Any], Pose]
    """Of a pose as it was read, the one that was meant; some are for 2D or 3D alone."""
    scale: float = 1.0
    """Metres of one unit of its positions, where a unit of the ranges is a metre."""
    mistakes: int = 1
    """How many it takes to get there."""


def _as_is(pose: Pose) -> Pose:
    return pose


AS_READ = PoseReading("", "", "", _as_is)
"""The pose as it was read."""


def _inverse(pose: Pose) -> Pose:
    return pose.inverse()


def _degrees(pose: Pose2) -> Pose:
    return Pose2(pose.x, pose.y, math.radians(pose.theta))


def _w_first(pose: Pose3) -> Pose:
    """The pose of a row `w x y z` that was read as `x y z w`."""
    w, x, y, z = quaternion_xyzw(pose.rotation)
    return Pose3.from_quaternion_xyzw(pose.translation, (x, y, z, w))


def _w_last(pose: Pose3) -> Pose:
    """The pose of a row `x y z w` that was read as `w x y z`."""
    x, y, z, w = quaternion_xyzw(pose.rotation)
    return Pose3.from_quaternion_xyzw(pose.translation, (w, x, y, z))


_DEGREES = PoseReading(
    "pose.headings_in_degrees", "headings in degrees", "write headings in radians", _degrees
)
_INVERSE = PoseReading(
    "pose.inverted",
    "poses that take the map to the sensor",
    "give their inverses, map_from_sensor",
    _inverse,
)
W_FIRST = PoseReading(
    "pose.quaternion_order", "quaternions with w first", "write them as qx qy qz qw", _w_first
)
"""The order of Eigen's constructor and of most books, where files have w last."""
_W_LAST = PoseReading(
    "pose.quaternion_order",
    "quaternions with w last, read as if it were first",
    "hand them over in the order that is asked for",
    _w_last,
)
_UNITS = (
    PoseReading(
        "pose.unit",
        "positions in millimetres beside ranges in metres",
        "divide positions by 1000",
        _as_is,
        1e-3,
    ),
    PoseReading(
        "pose.unit",
        "positions in centimetres beside ranges in metres",
        "divide positions by 100",
        _as_is,
        1e-2,
    ),
    PoseReading(
        "range.unit",
        "ranges in millimetres beside positions in metres",
        "divide ranges by 1000",
        _as_is,
        1e3,
    ),
    PoseReading(
        "range.unit",
        "ranges in centimetres beside positions in metres",
        "divide ranges by 100",
        _as_is,
        1e2,
    ),
)


def readings_of(d: int) -> tuple[PoseReading, ...]:
    """Other readings of poses of d dimensions, the likelier mistakes first."""
    forms = (_DEGREES, _INVERSE) if d == 2 else (W_FIRST, _INVERSE, _W_LAST)
    both = [
        PoseReading(
            form.code,
            f"{form.suspicion} and {unit.suspicion}",
            f"{form.remedy} and {unit.remedy}",
            form.read,
            unit.scale,
            2,
        )
        for form in forms
        for unit in _UNITS
        # An inverse of a pose in another unit is odd enough without it.
        if unit.scale in (1e-3, 1e3) and form is not _INVERSE
    ]
    return (*forms, *_UNITS, *both)
