# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose2
from oddsmap.simulate import FloorPlan, OverheadCamera, Rectangle

# Half of the plane is full: x > 1.
PLAN = FloorPlan([Rectangle(1.0, -50.0, 60.0, 50.0)])
PERFECT = OverheadCamera(
    height=2, width=4, pixel=1.0, corner=(0.0, 0.0), true_positive_rate=1, false_positive_rate=0
)


def test_exact_without_errors() -> None:
    rng = np.random.default_rng(0)
    scan = PERFECT.scan(PLAN, Pose2(-1.0, 0.0, 0.0), rng, stamp_ns=7)
    np.testing.assert_array_equal(scan.seen, [[0, 0, 1, 1]] * 2)
    assert scan.map_from_sensor == Pose2(-1.0, 0.0, 0.0)
    assert (scan.resolution, scan.corner, scan.stamp_ns) == (1.0, (0.0, 0.0), 7)
    # Heading north, columns go up and rows to the west; heading west, columns go there.
    seen = PERFECT.scan(PLAN, Pose2(2.0, 0.0, math.pi / 2), rng).seen
    np.testing.assert_array_equal(seen, [[1] * 4, [0] * 4])
    seen = PERFECT.scan(PLAN, Pose2(2.0, 0.0, math.pi), rng).seen
    np.testing.assert_array_equal(seen, [[1, 0, 0, 0]] * 2)


def test_the_grid_is_centred_by_default() -> None:
    camera = dataclasses.replace(PERFECT, corner=None)
    scan = camera.scan(PLAN, Pose2(1.0, 0.0, 0.0), np.random.default_rng(0))
    assert scan.corner == (-2.0, -1.0)
    np.testing.assert_array_equal(scan.seen, [[0, 0, 1, 1]] * 2)


def test_rates_are_those_of_the_confusion_model() -> None:
    camera = OverheadCamera(
        height=200, width=200, true_positive_rate=0.8, false_positive_rate=0.3, p_unseen=0.1
    )
    scan = camera.scan(PLAN, Pose2(1.0, 0.0, 0.0), np.random.default_rng(1))
    free, occupied = scan.seen[:, :100], scan.seen[:, 100:]
    for reading, rate in ((occupied, 0.8), (free, 0.3)):
        seen = ~np.isnan(reading)
        n = 20_000
        assert abs(seen.mean() - 0.9) < 5 * math.sqrt(0.09 / n)
        assert abs(reading[seen].mean() - rate) < 5 * math.sqrt(rate * (1 - rate) / (0.9 * n))
        assert set(np.unique(reading[seen])) == {0.0, 1.0}


def test_seeded_and_a_pixel_keeps_its_luck() -> None:
    camera, pose = OverheadCamera(), Pose2(1.0, 0.5, 0.3)
    first, again, other = (
        camera.scan(PLAN, pose, np.random.default_rng(seed)).seen for seed in (4, 4, 5)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    partial = dataclasses.replace(camera, p_unseen=0.3)
    seen = partial.scan(PLAN, pose, np.random.default_rng(4)).seen
    assert np.array_equal(seen[~np.isnan(seen)], first[~np.isnan(seen)])


@pytest.mark.parametrize(
    "change",
    [
        {"height": 0}, {"width": 0}, {"pixel": 0.0}, {"pixel": math.nan}, {"pixel": math.inf},
        {"corner": (0.0, math.nan)}, {"true_positive_rate": 1.1}, {"false_positive_rate": -0.1},
        {"p_unseen": math.nan},
    ],
)  # fmt: skip
def test_parameters_outside_their_range(change: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=f"OverheadCamera: .*{next(iter(change))}"):
        OverheadCamera(**change)


def test_a_pose_must_be_finite() -> None:
    with pytest.raises(InputError, match="not finite"):
        PERFECT.scan(PLAN, Pose2(math.nan, 0.0, 0.0), np.random.default_rng(0))
