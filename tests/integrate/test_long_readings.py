# SPDX-License-Identifier: Apache-2.0
"""A scan too large for memory is refused with its size in metres and with what makes it so."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from oddsmap.errors import MapTooLargeError
from oddsmap.evidence_map import EvidenceMap
from oddsmap.integrate.add import add_log
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.registry import Sensor


def ring(ranges: list[float]) -> Scan:
    turn = np.linspace(0.0, 2.0 * np.pi, len(ranges), endpoint=False)
    return Scan(Pose2(0.0, 0.0, 0.0), np.stack([np.cos(turn), np.sin(turn)], 1), np.array(ranges))


def refused(scan: Scan, resolution: float, sensor: Sensor, threads: int = 1) -> str:
    ndim = scan.directions.shape[1]
    grid = EvidenceMap(resolution, sensor=sensor, ndim=ndim)
    log = LoadedLog("hall.log", "toy", {}, Counter(), (), (scan,))
    with pytest.raises(MapTooLargeError) as caught:
        add_log(grid, log, threads=threads)
    text = str(caught.value)
    assert text.startswith("hall.log: ")
    assert "\n" not in text
    return text


@pytest.mark.parametrize("threads", [1, 2])
def test_millimetres(threads: int) -> None:
    text = refused(ring([4000.0, 5000.0, 6000.0, 90000.0]), 0.05, BeamSensor(), threads)
    # A half of the readings above the median, and those beyond half of the longest.
    assert "above 5500 m, 1 of 4 above 45000 m, and the longest is 90000 m; ranges are" in text
    assert text.endswith("metres, are these millimetres?)")
    # From 6000 m on the left to 4000 on the right, and 5000 m above to 90000 below; in whole tiles.
    assert "one scan spans 10000 x 95000 m, 3.8e+11 cells of 0.05 m (a scan may span" in text


def test_a_resolution_that_is_far_too_fine() -> None:
    text = refused(ring([4.0, 5.0, 6.0, np.inf, np.nan, 0.0]), 0.00002, BeamSensor())
    assert "spans 7.001 x 5.197 m, 9.1e+10 cells of 2e-05 m" in text
    assert text.endswith("(here half of the readings are above 5 m, 3 of 3 above 3 m, and the "
                         "longest is 6 m)")  # fmt: skip


def test_cones_and_3d() -> None:
    cone = refused(ring([4000.0] * 4), 0.05, ConeSensor(cone_deg=30.0))
    assert "are these millimetres?" in cone
    scan = Scan(Pose3(np.zeros(3), np.eye(3)), np.eye(3), np.array([4000.0, 4000.0, 4000.0]))
    assert "are these millimetres?" in refused(scan, 0.01, BeamSensor())
    assert refused(ring([9.0] * 3), 1e-6, ConeSensor(cone_deg=30.0)).endswith("longest is 9 m)")
