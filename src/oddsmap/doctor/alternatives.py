# SPDX-License-Identifier: Apache-2.0
"""Other things that a log may mean: the form and the unit of its poses, and how the sensor sits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from oddsmap.doctor.prediction import Placed
from oddsmap.doctor.trial import Alternative
from oddsmap.plausibility.pose_readings import PoseReading, readings_of
from oddsmap.plausibility.sample import Glance
from oddsmap.poses.pose import Pose, Pose2, Pose3

__all__ = ["AS_READ", "IN_MAP", "alternatives_of", "lie_around_sensor", "yawed"]

AS_READ = Alternative(
    code="", suspicion="", remedy="", place=lambda glance: Placed(glance.pose, glance.points)
)
"""A log as it was read."""

# Scans away from the origin, and their share, of which points in the map must speak.
_SCANS, _MOST = 8, 0.7

# body_from_optical: the optical frame of a camera (x right, y down, z forward) on a body with x
# forward, y left, z up (REP 103).
_OPTICAL = Pose3(np.zeros(3), np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))


def alternatives_of(d: int, body_from_sensor: Pose3 | None = None) -> list[Alternative]:
    """Other readings of a log of d dimensions, without a parameter.

    Args:
        d: 2 or 3.
        body_from_sensor: how the caller says that the sensor sits on the body whose poses are in
            the log: those are what may be inverted, not the sensor's.
    """
    mounted = body_from_sensor if d == 3 else None
    found = [
        _of_poses(reading, mounted)
        for reading in readings_of(d)
        # A unit of ranges is one of positions, seen from the other side; named as it is written.
        if reading.mistakes == 1
    ]
    if mounted is not None:
        found.append(
            Alternative(
                code="points.in_body",
                suspicion="points in the frame of the body already",
                remedy="leave --body-from-sensor out",
                place=lambda g: Placed(_after(g.pose, mounted.inverse()), g.points),
            )
        )
    found.append(
        Alternative(
            code="extrinsics.mirrored",
            suspicion="beams in the other order, right to left",
            remedy="reverse the ranges of each scan (or the sign of y)",
            place=lambda g: Placed(g.pose, g.points * np.array([1.0, -1.0, 1.0])[:d]),
        )
    )
    if d == 3:
        found += [
            _turned(
                _OPTICAL,
                "extrinsics.optical",
                "poses of the body for points in the optical frame of a camera",
            ),
            _turned(
                _OPTICAL.inverse(),
                "extrinsics.optical",
                "poses of an optical frame for points with x forward and z up",
            ),
        ]
    return found


def yawed(degrees: float, d: int) -> Alternative:
    """The sensor turned about its z axis [degrees]: it sits on the body in another way."""
    angle = math.radians(degrees)
    if d == 2:
        turn: Pose = Pose2(0.0, 0.0, angle)
    else:
        c, s = math.cos(angle), math.sin(angle)
        turn = Pose3(np.zeros(3), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    quaternion = f"0 0 0 0 0 {math.sin(angle / 2):.6g} {math.cos(angle / 2):.6g}"
    return Alternative(
        code="extrinsics.yaw",
        suspicion=f"scans of a sensor that is turned by {degrees:+.3g} degrees about its z axis",
        remedy=f'correct how it is mounted: after the present extrinsics "{quaternion}" '
        "(x y z qx qy qz qw)",
        place=lambda g: Placed(_after(g.pose, turn), g.points),
    )


IN_MAP = Alternative(
    code="points.in_map",
    suspicion="points in the frame of the map",
    remedy="say so with --points-in map, or turn them into the frame of the sensor",
    place=lambda glance: Placed(glance.pose, _back(glance.pose).transform(glance.points)),
)
"""Points that need no pose. Like a sensor that never moves they may look better than they are: to
be tried where `lie_around_sensor` says so."""


def lie_around_sensor(glances: Sequence[Glance]) -> bool:
    """Whether points, taken for those of the map, lie nearer to the sensor than to the origin."""
    nearer = []
    for glance in glances:
        at = glance.pose.translation
        if len(glance.points) and np.linalg.norm(at) > glance.typical_range / 2:
            away = np.sqrt(((glance.points - at) ** 2).sum(axis=1))
            nearer.append(float(np.median(away)) < 0.8 * glance.typical_range)
    return len(nearer) >= _SCANS and float(np.mean(nearer)) > _MOST


def _of_poses(reading: PoseReading, mounted: Pose3 | None) -> Alternative:
    def place(glance: Glance) -> Placed:
        if mounted is None:
            return Placed(reading.read(glance.pose), glance.points)
        body = reading.read(_after(glance.pose, mounted.inverse()))
        return Placed(_after(body, mounted), glance.points)

    return Alternative(
        code=reading.code,
        suspicion=reading.suspicion,
        remedy=reading.remedy,
        place=place,
        scale=reading.scale,
    )


def _back(pose: Pose) -> Pose:
    return pose.inverse()


def _turned(turn: Pose3, code: str, suspicion: str) -> Alternative:
    from oddsmap.poses.pose import quaternion_xyzw

    quaternion = " ".join(f"{q:g}" for q in quaternion_xyzw(turn.rotation))
    return Alternative(
        code=code,
        suspicion=suspicion,
        remedy=f'--body-from-sensor "0 0 0 {quaternion}"',
        place=lambda g: Placed(_after(g.pose, turn), g.points),
    )


def _after(first: Pose, second: Pose) -> Pose:
    """First @ second, of one dimension."""
    return first @ second  # type: ignore[operator]
