# SPDX-License-Identifier: Apache-2.0
"""Messages with bytes that are changed: beams, or one line that says why not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.recordings.depth_messages import camera_of
from oddsmap.recordings.livox_bytes import LIVOX_TYPES, livox_message
from oddsmap.recordings.scan_messages import SCAN_TYPES, beams_of
from tests.recordings.bags import Messages
from tests.recordings.test_livox_messages import LATE, POINTS
from tests.recordings.test_recorded_log import START

CLOUD = np.zeros(7, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4")])
DEPTH = np.full((4, 6), 2000, "<u2")


def several_echoes(ros: Messages) -> Any:
    echoes = [ros.make("sensor_msgs/LaserEcho", np.ones(2, np.float32)) for _ in range(4)]
    values: tuple[Any, ...] = (0.0, 0.3, 0.1, 0.0, 0.0, 0.1, 30.0, echoes, [])
    return ros.make("sensor_msgs/MultiEchoLaserScan", ros.header(START, "laser"), *values)


MADE: dict[str, Callable[[Messages], Any]] = {
    "laser": lambda ros: ros.laser(START, "laser", np.ones(9), every=1e-4),
    "echoes": several_echoes,
    "cloud": lambda ros: ros.cloud(START, "lidar", CLOUD),
    "range": lambda ros: ros.range(START, "sonar", 1.0),
    "image": lambda ros: ros.image(START, "cam", DEPTH, "16UC1", padding=2),
    "camera": lambda ros: ros.camera(START, "cam", (6, 4), (9.0, 9.0, 3.0, 2.0), distortion=[0.1]),
    "livox": lambda ros: ros.livox(START, "livox", POINTS, LATE),
}


@pytest.mark.parametrize("container", ["bag", "mcap"])
@pytest.mark.parametrize("name", MADE)
def test_changed_bytes(name: str, container: str) -> None:
    ros, rng = Messages(container), np.random.default_rng(7)
    message = MADE[name](ros)
    whole, store = message.__msgtype__, ros.store
    kind = whole.replace("/msg/", "/")
    write: Any = store.serialize_ros1 if ros.first else store.serialize_cdr
    read: Any = store.deserialize_ros1 if ros.first else store.deserialize_cdr
    raw = np.frombuffer(bytes(write(message, whole)), np.uint8)
    answers, lines = 0, list[str]()
    for _ in range(300):
        damaged = raw.copy()
        at = rng.integers(4, len(raw), rng.integers(1, 4))
        damaged[at] = rng.choice([0, 1, 127, 128, 255, int(rng.integers(256))], len(at))
        try:
            if kind in LIVOX_TYPES:
                data: Any = livox_message(damaged.tobytes(), cdr=not ros.first)
            else:
                data = read(damaged.tobytes(), whole)
        except Exception:  # noqa: S112 - what the library says, which whoever reads the file takes
            continue
        try:
            if kind in SCAN_TYPES:
                beams = beams_of(kind, data)
                for array in (beams.ranges, beams.points, beams.depth, beams.after_ns):
                    assert array is None or array.size < 10_000
            else:
                camera_of(data, "/cam/image_raw")
            answers += 1
        except InputError as error:
            lines.append(str(error))
    assert answers > 20
    assert not any("\n" in line for line in lines)
