# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose3
from oddsmap.scans.scan import Scan
from oddsmap.simulate import (
    Box,
    Cylinder,
    Ground,
    Lidar3D,
    Mover,
    MovingWorld,
    World3D,
    drive3d,
    town,
    traffic,
)

CAR = Box(9.0, 9.0, 4.0, 2.0, 0.1, 1.5)


def test_there_and_back_along_a_line() -> None:
    mover = Mover(CAR, np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0]]), 2.0, ahead=1.0)
    for time_s, x, y, yaw in ((0.0, 1.0, 0.0, 0.0), (2.0, 5.0, 0.0, 0.0), (6.0, 10.0, 3.0, 0.5)):
        box = mover.at(time_s)
        assert isinstance(box, Box)
        assert (box.x, box.y, box.yaw) == pytest.approx((x, y, yaw * math.pi))
        back = mover.at(14.0 - time_s)  # 15 m there and 15 m back, of which 1 m is behind it
        assert (back.x, back.y) == pytest.approx((x, y))
        assert (box.length, box.z_min, box.z_max) == (4.0, 0.1, 1.5)


def test_it_stands_on_the_ground() -> None:
    ground = Ground(z=2.0, waves=((0.3, 0.5, 0.1, 0.0),))
    walker = Mover(Cylinder(0.0, 0.0, 0.3, 0.0, 1.7), np.array([[0.0, 0.0], [4.0, 0.0]]), 1.0)
    solid = walker.at(3.0, ground)
    assert solid.z_min == pytest.approx(ground.height(np.array([3.0]), np.array([0.0]))[0])
    assert solid.z_max == pytest.approx(solid.z_min + 1.7)


def test_which_beams_meet_what_moves() -> None:
    """A car behind a wall is not met, one before it is: by the distances of each alone."""
    wall = Box(6.0, 0.0, 0.5, 20.0, 0.0, 3.0)
    cars = [Mover(CAR, np.array([[x, -9.0], [x, 9.0]]), 1.0, ahead=9.0) for x in (3.5, 9.0)]
    world = MovingWorld(World3D([wall], Ground()), cars)
    lidar = Lidar3D(16, 90, sigma=0.0, elevation_min=-0.4)
    pose = Pose3(np.eye(3), np.array([0.0, 0.0, 1.0]))
    scan = lidar.scan(world.at(0.0), pose, np.random.default_rng(0))
    meets = world.meets_movers(scan, 0.0)
    alone = World3D([cars[0].at(0.0)]).cast(pose.translation, lidar.directions)
    assert meets.any()
    assert np.array_equal(meets, np.isfinite(alone) & np.isclose(scan.ranges, alone))
    still = lidar.scan(world.still, pose, np.random.default_rng(0))
    assert np.array_equal(meets, scan.ranges < still.ranges)
    with pytest.raises(InputError, match="a scan in space is needed"):
        world.meets_movers(Scan.from_angles((0, 0, 0), [0.0], [1.0]), 0.0)


def test_traffic_keeps_to_the_street_and_leaves_room_for_the_sensor() -> None:
    movers = traffic(3)
    world = MovingWorld(town(3), movers)
    assert len(movers) == 15
    assert {type(mover.solid) for mover in movers} == {Box, Cylinder}
    for k, pose in enumerate(drive3d(100, ground=world.still.ground)):
        assert not world.at(0.2 * k).contains(pose.translation[None]).any()
    again = [mover.at(1.0) for mover in traffic(3)]
    assert again == [mover.at(1.0) for mover in movers]
    assert again != [mover.at(1.0) for mover in traffic(4)]


def test_what_is_refused() -> None:
    for route in ([[0.0, 0.0]], [[1.0, 1.0], [1.0, 1.0]], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]):
        with pytest.raises(ConfigError, match="a route has two points"):
            Mover(CAR, np.array(route), 1.0)
    for speed in (0.0, -1.0, float("nan")):
        with pytest.raises(ConfigError, match="the speed is above 0"):
            Mover(CAR, np.array([[0.0, 0.0], [1.0, 0.0]]), speed)
