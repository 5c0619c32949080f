# SPDX-License-Identifier: Apache-2.0
"""Points as Livox's drivers write them, of ROS 1 and of ROS 2."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import open_log
from oddsmap.errors import InputError
from oddsmap.recordings.livox_bytes import livox_message
from oddsmap.recordings.livox_messages import livox_beams
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
    log = open_log(messages.write(tmp_path / "run", said), deskew=False)
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


@pytest.mark.parametrize("container", ["bag", "mcap"])
@pytest.mark.parametrize("frame", ["", "a", "livox_frame", "/livox"])
@pytest.mark.parametrize("count", [0, 1, 3])
def test_bytes_are_read_as_the_library_reads_them(container: str, frame: str, count: int) -> None:
    messages = Messages(container)
    message = messages.livox(START + 5, frame, POINTS[:count], LATE[:count])
    kind = message.__msgtype__
    first = container == "bag"
    store = messages.store
    write: Any = store.serialize_ros1 if first else store.serialize_cdr
    read: Any = store.deserialize_ros1 if first else store.deserialize_cdr
    raw = bytes(write(message, kind))
    want = read(raw, kind)
    got = livox_message(raw, cdr=not first)
    assert got.header.frame_id == want.header.frame_id
    assert got.header.stamp.sec == want.header.stamp.sec
    assert got.header.stamp.nanosec == want.header.stamp.nanosec
    assert (got.timebase, got.point_num) == (want.timebase, want.point_num)
    fields = ("offset_time", "x", "y", "z")
    assert [tuple(point[name] for name in fields) for point in got.points] == [
        tuple(getattr(point, name) for name in fields) for point in want.points
    ]
    mine, theirs = livox_beams(got), livox_beams(want)
    for name in ("points", "after_ns"):
        np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name))
    for end in range(len(raw)):
        with pytest.raises((ValueError, struct.error, IndexError)):
            livox_message(raw[:end], cdr=not first)
