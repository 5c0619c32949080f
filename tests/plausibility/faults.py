# SPDX-License-Identifier: Apache-2.0
"""Good logs, and what people do to them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from oddsmap.poses.pose import Pose2, Pose3, quaternion_xyzw
from oddsmap.scans.depth_image import PinholeCamera
from oddsmap.scans.scan import Scan
from oddsmap.simulate import (
    DepthCamera,
    Lidar2D,
    Lidar3D,
    Sonar2D,
    drive3d,
    office_drive,
    office_plan,
    room,
    town,
)

Change = Callable[[Scan], Scan]


@cache
def office() -> tuple[Scan, ...]:
    """A drive of a 2D lidar."""
    rng, plan, lidar = np.random.default_rng(1), office_plan(), Lidar2D()
    return tuple(lidar.scan(plan, pose, rng) for pose in office_drive(320)[:120])


@cache
def street() -> tuple[Scan, ...]:
    """A drive of a 3D lidar."""
    rng, world, lidar = np.random.default_rng(1), town(1), Lidar3D(ring_count=16, column_count=120)
    return tuple(lidar.scan(world, pose, rng) for pose in drive3d(300)[:70])


@cache
def indoors() -> tuple[Scan, ...]:
    """A walk with a depth camera, its images as beams."""
    rng, world = np.random.default_rng(1), room()
    camera = DepthCamera(camera=PinholeCamera(32.0, 32.0, 19.5, 14.5, 40, 30))
    poses = []
    for k in range(80):
        around, down = 2 * math.pi * k / 200, 0.2 + 0.1 * math.sin(0.1 * k)
        at = np.array([1.5 * math.cos(around), 1.3 * math.sin(around), 1.4])
        ahead = np.array([math.cos(around), math.sin(around), 0.0]) * math.cos(down)
        ahead[2] = -math.sin(down)
        right = np.array([math.sin(around), -math.cos(around), 0.0])
        poses.append(Pose3(at, np.stack([right, np.cross(ahead, right), ahead], axis=1)))
    return tuple(camera.scan(world, pose, rng).to_scan() for pose in poses)


@cache
def sonars() -> tuple[Scan, ...]:
    """A drive with a ring of sonars: few beams, wide ones."""
    rng, sonar = np.random.default_rng(1), Sonar2D(beam_count=8)
    truth = np.zeros((80, 120), np.bool_)
    truth[[0, -1]] = truth[:, [0, -1]] = truth[30:34, 20:60] = truth[50:, 80:84] = True
    poses = [Pose2(2.0 + 0.08 * k, 1.5 + 0.01 * k, 0.01 * k) for k in range(90)]
    return tuple(sonar.scan(truth, 0.1, pose, rng) for pose in poses)


def with_poses(change: Callable[[Pose2 | Pose3], Pose2 | Pose3]) -> Change:
    return lambda scan: dataclasses.replace(scan, map_from_sensor=change(scan.map_from_sensor))


def in_units(per_metre: float) -> Change:
    """Positions in another unit."""

    def change(pose: Pose2 | Pose3) -> Pose2 | Pose3:
        if isinstance(pose, Pose2):
            return Pose2(pose.x * per_metre, pose.y * per_metre, pose.theta)
        return Pose3(pose.translation * per_metre, pose.rotation)

    return with_poses(change)


def ranges_in_units(per_metre: float) -> Change:
    return lambda scan: dataclasses.replace(scan, ranges=scan.ranges * per_metre)


def _degrees(pose: Pose2 | Pose3) -> Pose2:
    assert isinstance(pose, Pose2)
    return Pose2(pose.x, pose.y, math.degrees(pose.theta))


def _w_first(pose: Pose2 | Pose3) -> Pose3:
    """Written as w x y z, read as x y z w."""
    assert isinstance(pose, Pose3)
    x, y, z, w = quaternion_xyzw(pose.rotation)
    return Pose3.from_quaternion_xyzw(pose.translation, (w, x, y, z))


inverted = with_poses(lambda pose: pose.inverse())
headings_in_degrees = with_poses(_degrees)
w_first = with_poses(_w_first)


def spoilt(scans: Sequence[Scan], *changes: Change) -> list[Scan]:
    result = list(scans)
    for change in changes:
        result = [change(scan) for scan in result]
    return result
