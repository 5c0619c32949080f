# SPDX-License-Identifier: Apache-2.0
"""A sensor that never turns shows a quaternion with w first by being upside down."""

from __future__ import annotations

import numpy as np
import pytest

from oddsmap.plausibility.sample import Glance
from oddsmap.plausibility.upright import doubts_of_upright
from oddsmap.poses.pose import Pose3, quaternion_xyzw

POINTS = np.eye(3)


def glances(*xyzw: tuple[float, float, float, float], from_image: bool = False) -> list[Glance]:
    poses = [Pose3.from_quaternion_xyzw((k, 0.0, 0.0), q) for k, q in enumerate(xyzw)]
    return [Glance(pose, POINTS, 1.0, from_image) for pose in poses]


def test_the_identity_with_w_first() -> None:
    (doubt,) = doubts_of_upright(glances((1, 0, 0, 0), (1, 0, 0, 0)))
    assert doubt.code == "pose.quaternion_order"
    assert "upside down in each of 2 scans" in doubt


@pytest.mark.parametrize(
    "xyzw",
    [
        [(0, 0, 0, 1)],
        [(0, 0, 0.6, 0.8)],
        [(1, 0, 0, 0), (0, 0, 0, 1)],  # it is upright once
        [(0, 1, 0, 0)],  # w first it would be on its side or upside down as well
        [(0.8, 0.6, 0, 0), (0.6, 0.8, 0, 0)],  # a sensor that hangs from a turning robot
    ],
)
def test_no_doubt(xyzw: list[tuple[float, float, float, float]]) -> None:
    assert doubts_of_upright(glances(*xyzw)) == []


def test_an_image_may_be_upside_down() -> None:
    assert doubts_of_upright(glances((1, 0, 0, 0), from_image=True)) == []


@pytest.mark.parametrize("largest", range(4))
def test_a_quaternion_comes_back_whichever_component_is_largest(largest: int) -> None:
    q = np.array([0.1, -0.3, 0.2, 0.25])
    q[largest] = 0.9
    q /= np.linalg.norm(q)
    back = np.array(quaternion_xyzw(Pose3.from_quaternion_xyzw((0, 0, 0), q).rotation))
    np.testing.assert_allclose(back * np.sign(back @ q), q, atol=1e-12)
