# SPDX-License-Identifier: Apache-2.0
"""What a map of some scans says of others."""

from __future__ import annotations

import math

import numpy as np

from oddsmap.doctor.prediction import Placed, information
from oddsmap.poses.pose import Pose2, Pose3


def wall(pose: Pose2) -> Placed:
    """A wall at x = 5 m, seen in directions that differ from scan to scan."""
    angles = pose.theta + np.linspace(-0.6, 0.6, 97) + 0.001 * pose.y
    ends = np.stack([np.full(97, 5.0), pose.y + (5.0 - pose.x) * np.tan(angles)], axis=1)
    return Placed(pose, pose.inverse().transform(ends))


def rows(poses: list[Pose2]) -> list[Placed]:
    return [wall(pose) for pose in poses]


POSES = [Pose2(0.13 * k, 0.21 * k, 0.02 * k) for k in range(8)]


def test_scans_that_fit_say_nearly_all_that_can_be_said() -> None:
    # Of nine places on a beam one is occupied: to know which takes its entropy.
    entropy = -9 * (1 / 9 * math.log(1 / 9) + 8 / 9 * math.log(8 / 9))
    assert 0.5 * entropy < information(rows(POSES), 0.1) < entropy


def test_a_wrong_pose_says_less_and_more_so_the_more_wrong_it_is() -> None:
    right = rows(POSES)
    found = [information(right, 0.1)]
    for error in (0.2, 0.5, 1.0):
        moved = [
            Placed(Pose2(pose.x + error * (k % 2), pose.y, pose.theta), right[k].points)
            for k, pose in enumerate(POSES)
        ]
        found.append(information(moved, 0.1))
    assert found == sorted(found, reverse=True)
    assert found[-1] < 0.2 * found[0]


def test_scans_that_share_nothing_say_nothing() -> None:
    apart = [Placed(Pose2(1e6 * k, 0.0, 0.0), scan.points) for k, scan in enumerate(rows(POSES))]
    assert information(apart, 0.1) == 0.0


def test_in_space() -> None:
    rng = np.random.default_rng(0)
    scans = []
    for k in range(6):
        at = np.array([0.1 * k, 0.0, 0.0])
        ends = np.column_stack(
            [np.full(300, 4.0), rng.uniform(-2, 2, 300), rng.uniform(-1, 1, 300)]
        )
        scans.append(Placed(Pose3(at, np.eye(3)), ends - at))
    assert information(scans, 0.2) > 0.5
    assert information([Placed(s.pose, s.points * [1, 1, -5]) for s in scans], 0.2) > 0.0
