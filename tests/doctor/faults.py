# SPDX-License-Identifier: Apache-2.0
"""What people do to good logs, beyond tests/plausibility/faults.py."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from oddsmap.doctor.clock import in_plane, in_space
from oddsmap.poses.pose import Pose, Pose2, Pose3
from oddsmap.poses.trajectory import Trajectory
from oddsmap.scans.scan import Scan

OPTICAL = Pose3(np.zeros(3), np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))


def about_z(degrees: float, d: int) -> Pose:
    angle = math.radians(degrees)
    if d == 2:
        return Pose2(0.0, 0.0, angle)
    c, s = math.cos(angle), math.sin(angle)
    return Pose3(np.zeros(3), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def turned(scan: Scan, degrees: float) -> Scan:
    """The sensor sits on its body turned by an angle that nobody wrote down."""
    turn = about_z(degrees, scan.directions.shape[1])
    return dataclasses.replace(scan, map_from_sensor=scan.map_from_sensor @ turn)  # type: ignore[operator]


def mirrored(scan: Scan) -> Scan:
    flip = np.array([1.0, -1.0, 1.0])[: scan.directions.shape[1]]
    return dataclasses.replace(scan, directions=scan.directions * flip)


def optical(scan: Scan) -> Scan:
    """Poses of a body's optical frame for points with x forward."""
    assert isinstance(scan.map_from_sensor, Pose3)
    return dataclasses.replace(scan, map_from_sensor=scan.map_from_sensor @ OPTICAL)


def y_down(scan: Scan) -> Scan:
    """The world of a camera."""
    assert isinstance(scan.map_from_sensor, Pose3)
    return dataclasses.replace(scan, map_from_sensor=OPTICAL.inverse() @ scan.map_from_sensor)


def in_map(scan: Scan) -> Scan:
    """Points that are in the frame of the map already."""
    seen = np.isfinite(scan.ranges)
    points = scan.map_from_sensor.transform(scan.directions[seen] * scan.ranges[seen, None])
    ranges = np.sqrt((points**2).sum(axis=1))
    return Scan(scan.map_from_sensor, points / ranges[:, None], ranges, scan.stamp_ns)


def seeing_itself(scan: Scan) -> Scan:
    """The first beams end at the robot, all of the time."""
    ranges = scan.ranges.copy()
    ranges[: max(3, len(ranges) // 30)] = 0.35
    return dataclasses.replace(scan, ranges=ranges)


def with_zeros(scan: Scan) -> Scan:
    ranges = scan.ranges.copy()
    ranges[::9] = 0.0
    return dataclasses.replace(scan, ranges=ranges)


def stamped(scans: Sequence[Scan], every_s: float = 0.1) -> list[Scan]:
    return [
        dataclasses.replace(scan, stamp_ns=round(i * every_s * 1e9)) for i, scan in enumerate(scans)
    ]


def late(scans: Sequence[Scan], seconds: float) -> list[Scan]:
    """Each scan with the pose of an earlier time."""
    stamps = np.array([scan.stamp_ns for scan in scans], np.int64)
    poses = [in_space(scan.map_from_sensor) for scan in scans]
    track = Trajectory(
        np.array([pose.translation for pose in poses]),
        np.array([pose.rotation for pose in poses]),
        stamps,
    )
    found = []
    for scan in scans:
        assert scan.stamp_ns is not None
        then = scan.stamp_ns - round(seconds * 1e9)
        if stamps[0] <= then <= stamps[-1]:
            pose = track.at(then, 10**12)
            flat = isinstance(scan.map_from_sensor, Pose2)
            there: Pose = in_plane(pose) if flat else pose
            found.append(dataclasses.replace(scan, map_from_sensor=there))
    return found


def drifted(scans: Sequence[Scan]) -> list[Scan]:
    """Poses summed up by wheels that turn a little more on one side."""
    found, before, at = [], scans[0].map_from_sensor, scans[0].map_from_sensor
    for scan in scans:
        step = before.inverse() @ scan.map_from_sensor  # type: ignore[operator]
        way = float(np.linalg.norm(step.translation))
        at = at @ step @ about_z(0.6 * way, scan.directions.shape[1])  # type: ignore[operator]
        before = scan.map_from_sensor
        found.append(dataclasses.replace(scan, map_from_sensor=at))
    return found
