# SPDX-License-Identifier: Apache-2.0
"""Real logs: none is doubted as it is, each fault put into one is named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import oddsmap
from oddsmap.scans.log import Log
from tests.plausibility.faults import headings_in_degrees, in_units, inverted, spoilt, w_first

pytestmark = pytest.mark.realdata

Open = Callable[[Path], Log]


def carmen(name: str) -> Open:
    return lambda data: oddsmap.open_log(data / "laser2d" / name)


def clouds(name: str) -> Open:
    def open_it(data: Path) -> Log:
        folder = data / "lidar3d" / name
        return oddsmap.open_log(folder, poses=folder / "poses_kitti.txt")

    return open_it


FLAT = [carmen(f"{name}-corrected.log.gz") for name in ("intel", "aces", "orebro")]
SPACE = [clouds("hall_os0"), clouds("hku1_avia")]


@pytest.mark.parametrize("open_it", [*FLAT, carmen("aces-raw.clf.bz2"), *SPACE])
def test_none_is_doubted_and_millimetres_are_named(open_it: Open, data_folder: Path) -> None:
    log = open_it(data_folder)
    assert oddsmap.check_log(log) == ()
    limit = log.sensor.get("range_max")
    doubts = oddsmap.check_log(spoilt(list(log), in_units(1000)), range_max=limit)
    assert [doubt.code for doubt in doubts] == ["pose.unit"]


@pytest.mark.parametrize("open_it", FLAT)
def test_faults_in_2d(open_it: Open, data_folder: Path) -> None:
    log = open_it(data_folder)
    for fault, code in (
        (headings_in_degrees, "pose.headings_in_degrees"),
        (inverted, "pose.inverted"),
    ):
        doubts = oddsmap.check_log(spoilt(list(log), fault), range_max=log.sensor["range_max"])
        assert [doubt.code for doubt in doubts] == [code]


@pytest.mark.parametrize("open_it", SPACE)
def test_faults_in_3d(open_it: Open, data_folder: Path) -> None:
    scans = list(open_it(data_folder))
    for fault, code in ((w_first, "pose.quaternion_order"), (inverted, "pose.inverted")):
        assert [doubt.code for doubt in oddsmap.check_log(spoilt(scans, fault))] == [code]


def test_images_are_not_doubted(data_folder: Path) -> None:
    assert oddsmap.check_log(oddsmap.open_log(data_folder / "rgbd" / "7scenes")) == ()
