# SPDX-License-Identifier: Apache-2.0
"""Scans taken out of their log keep what the log states about the sensor."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import BeamSensor, EvidenceMap, InputError, Pose3, add_scans, build_map, open_log
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.log import Log

FAR = 81.83
"""What is written where nothing was seen, nine times of ten."""


def write_log(path: Path, far: float = FAR) -> Log:
    lines = []
    for i in range(30):
        readings = [f"{2 + i / 50:.2f}", *[f"{far}"] * 9, f"{3 - i / 70:.2f}", *[f"{far}"] * 9]
        pose = f"{i / 10:.2f} 0 0"
        lines.append(f"FLASER 20 {' '.join(readings)} {pose} {pose} {i}.0 host {i}.0\n")
    path.write_text("".join(lines))
    return open_log(path)


@pytest.fixture
def log(tmp_path: Path) -> Log:
    found = write_log(tmp_path / "run.log")
    assert found.sensor == {"range_max": FAR}
    return found


def cells(grid: EvidenceMap) -> list[Any]:
    return [array.tolist() for array in grid.cells()]


@pytest.mark.parametrize("take", [list, tuple, iter, lambda log: (scan for scan in log)])
def test_without_their_log(log: Log, take: Callable[[Log], Iterable[Any]]) -> None:
    whole = build_map(log, 0.1)
    part = build_map(take(log), 0.1)
    assert part.sensor == whole.sensor == BeamSensor(range_max=FAR)
    assert cells(part) == cells(whole)


def test_copies_know_it_too(log: Log) -> None:
    scans = [pickle.loads(pickle.dumps(copy.copy(scan))) for scan in log]
    assert cells(build_map(scans, 0.1)) == cells(build_map(log, 0.1))


def test_depth_images_become_beams_that_know_it() -> None:
    camera = PinholeCamera(4.0, 4.0, 1.5, 1.5, 4, 4)
    pose = Pose3(np.zeros(3), np.eye(3))
    image = DepthScan(pose, np.ones((4, 4), np.float32), camera)
    object.__setattr__(image, "stated", {"range_max": 4.0})
    assert image.to_scan().stated == {"range_max": 4.0}


def test_scans_of_logs_that_state_different_things(log: Log, tmp_path: Path) -> None:
    other = write_log(tmp_path / "other.log", 29.9)
    both = [*log, *other]
    for scans in (both, iter(both)):
        with pytest.raises(InputError, match=r"scan 30 .* range_max 29.9 .* range_max 81.83"):
            build_map(scans, 0.1)
    # Who says what the sensor is like has decided.
    assert build_map(both, 0.1, sensor=BeamSensor(range_max=29.9)).report.scans == 60  # type: ignore[union-attr]


def test_a_sensor_without_range_max_is_doubted(log: Log) -> None:
    with pytest.warns(UserWarning, match=r"range_max 81.83 m.*give range_max=81.83"):
        build_map(log, 0.1, sensor=BeamSensor(p_hit=0.8))
    with pytest.warns(UserWarning, match=r"range_max 81.83 m"):
        add_scans(EvidenceMap(0.1), list(log))
