# SPDX-License-Identifier: Apache-2.0
"""Good logs are let be; each fault in one is named, with what to do."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

import oddsmap
from oddsmap.scans.scan import Scan
from tests.doctor.faults import (
    drifted,
    in_map,
    late,
    mirrored,
    optical,
    seeing_itself,
    stamped,
    turned,
    with_zeros,
)
from tests.plausibility.faults import (
    headings_in_degrees,
    in_units,
    inverted,
    office,
    ranges_in_units,
    spoilt,
    street,
    w_first,
)

Spoil = Callable[[list[Scan]], list[Scan]]


def each(change: Callable[[Scan], Scan]) -> Spoil:
    return lambda scans: spoilt(scans, change)


def codes(scans: list[Scan]) -> list[str]:
    return [finding.code for finding in oddsmap.diagnose(scans).findings]


def test_good_logs_are_let_be() -> None:
    for scans in (office(), street()):
        found = oddsmap.diagnose(stamped(scans))
        assert found.findings == ()
        assert found.sensors[0].scans == len(scans)
        assert found.sensors[0].information > 0.3


FAULTS_2D: list[tuple[Spoil, str, str]] = [
    (each(inverted), "pose.inverted", "give their inverses"),
    (each(headings_in_degrees), "pose.headings_in_degrees", "in radians"),
    (each(in_units(1000)), "pose.unit", "divide positions by 1000"),
    (each(ranges_in_units(1000)), "range.unit", "divide ranges by 1000"),
    (each(mirrored), "extrinsics.mirrored", "reverse the ranges"),
    (each(partial(turned, degrees=90)), "extrinsics.yaw", "how it is mounted"),
    (each(partial(turned, degrees=-6)), "extrinsics.yaw", "how it is mounted"),
    (each(in_map), "points.in_map", "--points-in map"),
    (partial(late, seconds=0.3), "clock.offset", "--clock-offset 0.3"),
    (each(seeing_itself), "range.own_body", "--set sensor.body_min="),
    (each(with_zeros), "range.zero", "+Inf"),
]
FAULTS_3D: list[tuple[Spoil, str, str]] = [
    (each(w_first), "pose.quaternion_order", "qx qy qz qw"),
    (each(inverted), "pose.inverted", "give their inverses"),
    (each(in_units(1000)), "pose.unit", "divide positions by 1000"),
    (each(optical), "extrinsics.optical", "--body-from-sensor"),
    (each(partial(turned, degrees=20)), "extrinsics.yaw", "how it is mounted"),
]


def some(faults: list[tuple[Spoil, str, str]], *quick: str) -> list[object]:
    """Faults, of which those that are not named take part with --slow only."""
    return [
        pytest.param(*fault, id=fault[1], marks=() if fault[1] in quick else pytest.mark.slow)
        for fault in faults
    ]


@pytest.mark.parametrize(
    ("spoil", "code", "remedy"),
    some(FAULTS_2D, "pose.inverted", "points.in_map", "clock.offset", "range.own_body"),
)
def test_faults_in_2d(spoil: Spoil, code: str, remedy: str) -> None:
    found = oddsmap.diagnose(spoil(stamped(office()))).findings
    assert [finding.code for finding in found] == [code]
    assert remedy in found[0]


@pytest.mark.parametrize(("spoil", "code", "remedy"), some(FAULTS_3D, "extrinsics.optical"))
def test_faults_in_3d(spoil: Spoil, code: str, remedy: str) -> None:
    found = oddsmap.diagnose(spoil(stamped(street()))).findings
    assert [finding.code for finding in found] == [code]
    assert remedy in found[0]


def test_times() -> None:
    scans = stamped(office())[:40]
    assert codes([scan for scan in scans for _ in (0, 1)]) == ["stamp.repeated"]
    assert codes(scans[20:] + scans[:20]) == ["stamp.backward"]


@pytest.mark.realdata
def test_raw_odometry(data_folder: Path) -> None:
    def found(name: str) -> list[str]:
        log = oddsmap.open_log(data_folder / "laser2d" / name)
        return [finding.code for finding in oddsmap.diagnose(log).findings]

    assert found("aces-raw.clf.bz2") == ["pose.drift"]
    assert found("aces-corrected.log.gz") == []


@pytest.mark.realdata
def test_drift_is_found_in_another_log(data_folder: Path) -> None:
    log = oddsmap.open_log(data_folder / "laser2d" / "intel-corrected.log.gz")
    scans = [scan for scan in log if isinstance(scan, Scan)]
    found = oddsmap.diagnose(drifted(scans), range_max=log.sensor["range_max"])
    assert "pose.drift" in [finding.code for finding in found.findings]


def test_nothing_to_look_at() -> None:
    assert oddsmap.diagnose([]).findings == ()
    assert oddsmap.diagnose(list(office()[:2])).findings == ()
