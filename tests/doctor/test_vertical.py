# SPDX-License-Identifier: Apache-2.0
"""A robot's way is plane across the vertical."""

from __future__ import annotations

import math

import numpy as np
import pytest

from oddsmap.doctor.examined import examine
from oddsmap.doctor.vertical import doubts_of_vertical
from oddsmap.poses.pose import Pose3
from oddsmap.scans.scan import Scan
from tests.doctor.faults import y_down


def around(rise: float) -> list[Scan]:
    """Scans on a circle of 5 m, up and down by some metres."""
    rng, found = np.random.default_rng(0), []
    for angle in np.linspace(0.0, 6.0, 40):
        at = np.array([5.0 * math.cos(angle), 5.0 * math.sin(angle), rise * math.sin(3 * angle)])
        found.append(Scan.from_points(Pose3(at, np.eye(3)), rng.uniform(-3.0, 3.0, (50, 3))))
    return found


def test_a_level_way_is_as_it_should_be() -> None:
    assert doubts_of_vertical(examine(around(0.1))[0]) == []


def test_the_world_of_a_camera_is_named() -> None:
    doubts = doubts_of_vertical(examine([y_down(scan) for scan in around(0.1)])[0])
    assert [doubt.code for doubt in doubts] == ["pose.vertical"]
    assert "is y the vertical" in doubts[0]


@pytest.mark.parametrize("change", [lambda scan: scan, y_down])
def test_a_way_in_all_directions_says_nothing(change: object) -> None:
    assert callable(change)
    assert doubts_of_vertical(examine([change(scan) for scan in around(4.0)])[0]) == []
