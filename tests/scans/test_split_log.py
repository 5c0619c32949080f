# SPDX-License-Identifier: Apache-2.0
"""Which scans are held out, and that the others are all the rest."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.errors import ConfigError
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.scans.note import Note
from oddsmap.scans.split_log import every_of, hold_out, run_of
from tests.kit import fan_scan


def log_of(count: int) -> LoadedLog:
    scans = tuple(fan_scan(float(i), 0.0, 0.0, [1.0]) for i in range(count))
    return LoadedLog("run.log", "CARMEN", {"range_max": 5.0}, Counter({"line.short": 2}),
                     (Note("a", code="a"),),
                     scans)  # fmt: skip


@given(st.integers(0, 30), st.integers(2, 12))
def test_each_scan_is_on_one_side(count: int, every: int) -> None:
    log = log_of(count)
    kept, held = hold_out(log, every)
    assert list(held) == [scan for i, scan in enumerate(log, 1) if i % every == 0]
    assert sorted(map(id, [*kept, *held])) == sorted(map(id, log))
    assert (len(kept), len(held)) == (len(list(kept)), len(list(held)))
    assert list(kept) == list(kept), "can be started again"


@given(st.integers(0, 60), st.integers(2, 5), st.integers(1, 7))
def test_runs_are_held_out_whole(count: int, every: int, run: int) -> None:
    log = log_of(count)
    kept, held = hold_out(log, every, run)
    assert list(held) == [scan for i, scan in enumerate(log) if i // run % every == every - 1]
    assert sorted(map(id, [*kept, *held])) == sorted(map(id, log))
    assert (len(kept), len(held)) == (len(list(kept)), len(list(held)))


def test_a_run_is_a_hundredth_of_the_log() -> None:
    assert [run_of(log_of(n)) for n in (0, 20, 299, 300, 1234)] == [2, 2, 2, 3, 12]
    with pytest.raises(ConfigError, match="a run has 1 scan or more"):
        hold_out(log_of(3), 2, 0)


def test_what_the_log_says_is_handed_on() -> None:
    kept, _ = hold_out(log_of(3), 2)
    assert (kept.path, kept.format, kept.sensor) == ("run.log", "CARMEN", {"range_max": 5.0})
    assert (kept.skipped, kept.notes) == ({"line.short": 2}, ("a",))
    assert kept.sensors[""].settings == {"range_max": 5.0}


def test_depth_images_stay_images(tmp_path: Path) -> None:
    from oddsmap.poses.pose import Pose3
    from oddsmap.scans.lazy_log import DepthLog

    camera = PinholeCamera(2.0, 2.0, 1.5, 1.5, width=4, height=4)

    def image(i: int) -> DepthScan:
        depth = np.full((4, 4), 1.0 + i, np.float32)
        return DepthScan(Pose3(np.zeros(3), np.eye(3)), depth, camera)

    log = DepthLog(
        path=str(tmp_path), format="RGB-D", scan_count=5, camera=camera, read_scan=image,
    )  # fmt: skip
    kept, held = hold_out(log, 2)
    images: list[Any] = list(kept)
    assert [float(image.depth[0, 0]) for image in images] == [1.0, 3.0, 5.0]
    assert len(list(held)) == 2


@pytest.mark.parametrize(
    ("share", "every"), [(0.1, 10), (0.5, 2), (0.25, 4), (0.3, 3), (0.01, 100)]
)
def test_shares(share: float, every: int) -> None:
    assert every_of(share) == every


@pytest.mark.parametrize("share", [0.0, -0.1, 0.51, float("nan")])
def test_wrong_shares(share: float) -> None:
    with pytest.raises(ConfigError, match=r"lies above 0 and up to 0\.5"):
        every_of(share)
    with pytest.raises(ConfigError, match="at least 2, got 1"):
        hold_out(log_of(2), 1)
