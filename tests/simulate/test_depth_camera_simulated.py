# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose3
from oddsmap.scans.depth_image import PinholeCamera
from oddsmap.simulate import Box, DepthCamera, World3D, room, room_walk
from tests.naive import world3d_oracle as oracle

# Looks along the map's x axis: z forward is x, x right is -y, y down is -z.
AHEAD = Pose3(np.array([0.0, 0.0, 1.0]), np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]))
TINY = PinholeCamera(fx=20.0, fy=20.0, cx=15.5, cy=11.5, width=32, height=24)
EXACT = DepthCamera(TINY, sigma=0.0)


def test_a_wall_across_the_axis_has_one_depth() -> None:
    scan = EXACT.scan(World3D([Box(4, 0, 2, 50, -50, 50)]), AHEAD, np.random.default_rng(0))
    assert scan.depth.shape == (24, 32)
    assert scan.depth.dtype == np.float32
    np.testing.assert_allclose(scan.depth, 3.0, rtol=1e-6)
    assert scan.camera is TINY
    assert scan.map_from_sensor is AHEAD


def test_right_is_right_and_down_is_down() -> None:
    # One crate to the right (negative y), below the axis.
    scan = EXACT.scan(World3D([Box(2, -1, 0.4, 0.4, 0.0, 0.6)]), AHEAD, np.random.default_rng(0))
    rows, columns = np.nonzero(scan.depth)
    assert len(rows)
    assert rows.min() > TINY.cy
    assert columns.min() > TINY.cx


def test_against_the_oracle() -> None:
    world = room()
    for pose in room_walk(5):
        scan = EXACT.scan(world, pose, np.random.default_rng(0)).to_scan()
        at = tuple(pose.translation.tolist())
        ways = (scan.directions @ pose.rotation.T).tolist()
        for t, way in list(zip(scan.ranges, ways, strict=True))[::7]:
            near, far = (oracle.cast(world, at, tuple(way), s, 9.0) for s in (1e-9, -1e-9))
            depth = near * (np.asarray(way) @ pose.rotation[:, 2])
            if np.isnan(t):
                assert not 0.4 + 1e-6 < depth < 6.0 - 1e-6
            else:
                assert min(near, far) - 1e-6 <= t <= max(near, far) + 1e-6


def test_readings_out_of_range_are_0() -> None:
    wall = World3D([Box(4, 0, 2, 50, -50, 50)])
    for low, high in ((3.1, 6.0), (0.4, 3.0)):
        camera = DepthCamera(TINY, range_min=low, range_max=high, sigma=0.0)
        assert not camera.scan(wall, AHEAD, np.random.default_rng(0)).depth.any()
    assert not EXACT.scan(World3D([]), AHEAD, np.random.default_rng(0)).depth.any()


def test_noise_grows_with_the_square_of_the_depth() -> None:
    camera = DepthCamera(sigma=0.002)
    spread = []
    for x in (1.0, 2.0, 4.0):
        wall = World3D([Box(x + 1, 0, 2, 50, -50, 50)])
        scan = camera.scan(wall, AHEAD, np.random.default_rng(2), stamp_ns=3)
        assert abs(scan.depth.mean() - x) < 5 * 0.002 * x * x / 500 + 1e-6
        spread.append(scan.depth.std(dtype=np.float64))
        assert scan.stamp_ns == 3
    np.testing.assert_allclose(spread, [0.002, 0.008, 0.032], rtol=0.01)


@pytest.mark.parametrize(
    "change",
    [
        {"range_min": -1.0},
        {"range_min": 7.0},
        {"range_max": math.inf},
        {"range_max": math.nan},
        {"sigma": -1.0},
        {"sigma": math.nan},
    ],
)
def test_a_parameter_out_of_range_is_refused(change: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=f"DepthCamera: .*{next(iter(change))}"):
        DepthCamera(**change)  # type: ignore[arg-type]


def test_a_pose_that_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="stands inside"):
        EXACT.scan(World3D([Box(0, 0, 2, 2, 0, 3)]), AHEAD, np.random.default_rng(0))
