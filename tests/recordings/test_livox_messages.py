# SPDX-License-Identifier: Apache-2.0
"""Points as Livox's drivers write them, of ROS 1 and of ROS 2."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap import open_log
from oddsmap.errors import InputError
from oddsmap.recordings.scan_messages import beams_of
from tests.recordings.bags import CONTAINERS, Messages
from tests.recordings.test_recorded_log import SECOND, START, drive

POINTS = np.array([[1.0, 2.0, 3.0], [4.0, 0.5, -1.0], [0.0, 0.0, 0.0]])
LATE = (0, 40_000_000, 99_000_000)


@pytest.mark.parametrize("container", CONTAINERS)
def test_points_and_their_times(container: str, tmp_path: Path) -> None:
    messages = Messages(container)
    said = [each for each in drive(messages) if each[0] != "/scan"]
    at = START + SECOND
    said.append(("/livox/lidar", at, messages.livox(at, "laser", POINTS, LATE)))
    log = open_log(messages.write(tmp_path / "run", said))
    (scan,) = log
    assert scan.measured_points is not None
    np.testing.assert_allclose(scan.measured_points, POINTS, rtol=1e-7)
    assert scan.ranges[2] == 0.0  # which is counted, and marks nothing
    assert scan.beam_times_ns is not None
    assert scan.beam_times_ns.tolist() == [at + late for late in LATE]


def test_times_of_another_clock_count_from_the_stamp() -> None:
    messages = Messages("bag")
    message = messages.livox(START, "livox", POINTS, LATE)
    message.timebase = 77 * SECOND
    after = beams_of("livox_ros_driver/CustomMsg", message).after_ns
    assert after is not None
    assert after.tolist() == list(LATE)


def test_a_count_that_is_wrong() -> None:
    message = Messages("bag").livox(START, "livox", POINTS, LATE)
    message.point_num = 4_000_000_000
    with pytest.raises(InputError, match="of 4000000000 points that holds 3"):
        beams_of("livox_ros_driver2/CustomMsg", message)
