# SPDX-License-Identifier: Apache-2.0
"""One rule for readings: the same odd ones, on each way that they can go."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from oddsmap.config.config import Config, MapConfig
from oddsmap.evidence_map import EvidenceMap
from oddsmap.full_map.online import OnlineFullMap
from oddsmap.integrate.add import add_scans
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.registry import Sensor
from oddsmap.sensors.usable_beams import judge_readings, usable_beams

RANGE_MIN, RANGE_MAX, CLEAR_RANGE = 0.5, 5.0, 3.0
HIT, CLEARS = "hit", "clears"
NAN, BELOW, LOST = "beam.nan", "beam.below_range_min", "beam.no_return"

# reading -> its verdict where no clear_range is set, and where one is
TABLE = {
    math.nan: (NAN, NAN),
    -math.inf: (BELOW, BELOW),
    -1.0: (BELOW, BELOW),
    0.0: (BELOW, BELOW),
    np.nextafter(RANGE_MIN, 0.0): (BELOW, BELOW),
    RANGE_MIN: (HIT, HIT),
    2.0: (HIT, HIT),
    np.nextafter(RANGE_MAX, 0.0): (HIT, HIT),
    RANGE_MAX: (LOST, CLEARS),
    81.83: (LOST, CLEARS),
    math.inf: (CLEARS, CLEARS),
}
# A depth image says 0, less, or infinity where it has nothing to say.
OF_DEPTH = {-math.inf: NAN, -1.0: NAN, 0.0: NAN, math.inf: NAN}

Verdict = Callable[[float, float | None], str]


def sensor_of(kind: str, clear_range: float | None) -> BeamSensor | ConeSensor:
    if kind == "cone":
        return ConeSensor(
            cone_deg=10.0, range_min=RANGE_MIN, range_max=RANGE_MAX, clear_range=clear_range
        )
    return BeamSensor(range_min=RANGE_MIN, range_max=RANGE_MAX, clear_range=clear_range)


def scan_of(reading: float, ndim: int) -> Scan:
    pose = Pose2(0.0, 0.0, 0.0) if ndim == 2 else Pose3(np.zeros(3), np.eye(3))
    return Scan(pose, np.eye(ndim)[:1], np.array([reading]))


def image_of(depth: float) -> DepthScan:
    camera = PinholeCamera(1.0, 1.0, 0.0, 0.0, width=1, height=1)
    return DepthScan(Pose3(np.zeros(3), np.eye(3)), np.array([[depth]]), camera)


def of_map(scan: Scan | DepthScan, sensor: Sensor, ndim: int, method: str = "rays") -> str:
    grid = EvidenceMap(0.25, sensor=sensor, ndim=ndim)
    report = add_scans(grid, [scan], method=method)
    reasons = [reason for reason in report.skipped if reason.startswith("beam.")]
    assert len(reasons) == (report.beams == 0), "used, or skipped for one reason"
    if reasons:
        assert grid.cell_count() == 0
        return reasons[0]
    return HIT if grid.cells()[1].any() else CLEARS


def of_full_map(reading: float, kind: str, clear_range: float | None) -> str:
    sensor = sensor_of(kind, clear_range)
    beams, _, skipped = usable_beams([scan_of(reading, 2)], sensor)
    online = OnlineFullMap(Config(map=MapConfig(resolution=0.25), sensor=sensor))
    online.add_scans([scan_of(reading, 2)])
    assert online.report.skipped == skipped
    if len(beams) == 0:
        return next(reason for reason in skipped if reason.startswith("beam."))
    return CLEARS if math.isinf(beams.ranges[0]) else HIT


WAYS: dict[str, Verdict] = {
    "2D beam": lambda z, clear: of_map(scan_of(z, 2), sensor_of("beam", clear), 2),
    "3D beam": lambda z, clear: of_map(scan_of(z, 3), sensor_of("beam", clear), 3),
    "2D cone": lambda z, clear: of_map(scan_of(z, 2), sensor_of("cone", clear), 2),
    "3D cone": lambda z, clear: of_map(scan_of(z, 3), sensor_of("cone", clear), 3),
    "depth, rays": lambda z, clear: of_map(image_of(z), sensor_of("beam", clear), 3),
    "depth, projective": lambda z, clear: of_map(
        image_of(z), sensor_of("beam", clear), 3, "projective"
    ),
    "full map of beams": lambda z, clear: of_full_map(z, "beam", clear),
    "full map of cones": lambda z, clear: of_full_map(z, "cone", clear),
}


@pytest.mark.parametrize("reading", TABLE, ids=str)
@pytest.mark.parametrize("way", WAYS)
def test_each_way_finds_the_same(way: str, reading: float) -> None:
    for clear_range, wanted in zip((None, CLEAR_RANGE), TABLE[reading], strict=True):
        if way.startswith("depth"):
            wanted = OF_DEPTH.get(reading, wanted)
        if way == "full map of cones" and wanted == LOST:
            wanted = CLEARS  # a fault, perhaps: the forward model has p_dropout for it
        assert WAYS[way](reading, clear_range) == wanted, clear_range


@pytest.mark.parametrize("way", WAYS)
def test_zero_neither_marks_nor_clears(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Drivers write 0 where there was no return; no range_min has to be given for that."""
    monkeypatch.setitem(globals(), "RANGE_MIN", 0.0)
    wanted = NAN if way.startswith("depth") else "beam.zero_range"
    for clear_range in (None, CLEAR_RANGE):
        assert WAYS[way](0.0, clear_range) == wanted


def test_arrays_are_sorted_as_single_readings_are() -> None:
    limits = BeamSensor(range_min=RANGE_MIN, range_max=RANGE_MAX).limits
    readings = np.array(list(TABLE))
    verdicts = judge_readings(readings, limits)
    assert verdicts.seen.tolist() == [TABLE[z][0] == HIT for z in TABLE]
    assert verdicts.used.tolist() == [TABLE[z][0] in (HIT, CLEARS) for z in TABLE]
    assert +verdicts.skipped == {NAN: 1, BELOW: 4, LOST: 2}
    assert np.array_equal(verdicts.reach[verdicts.seen], readings[verdicts.seen])
    assert verdicts.reach[-1] == RANGE_MAX
    assert np.isnan(verdicts.reach[~verdicts.used]).all()


@pytest.mark.parametrize("where", [1e14, math.nan])
def test_a_scan_skipped_for_its_pose_has_its_beams_counted_nowhere(where: float) -> None:
    reason = "scan.nan_pose" if math.isnan(where) else "scan.pose_too_far"
    readings = np.array([math.nan, 0.1, 81.83, 2.0])
    flat = Scan(Pose2(where, 0.0, 0.0), np.eye(2)[[0, 1, 0, 1]], readings)
    deep_pose = Pose3(np.array([where, 0.0, 0.0]), np.eye(3))
    deep = Scan(deep_pose, np.eye(3)[[0, 1, 2, 0]], readings)
    camera = PinholeCamera(1.0, 1.0, 0.0, 0.0, width=4, height=1)
    image = DepthScan(deep_pose, readings[None].astype(np.float32), camera)
    ways: list[tuple[Scan | DepthScan, str, str]] = [
        (flat, "beam", "rays"),
        (flat, "cone", "rays"),
        (deep, "beam", "rays"),
        (deep, "cone", "rays"),
        (image, "beam", "rays"),
        (image, "beam", "projective"),
    ]
    for scan, kind, method in ways:
        sensor = sensor_of(kind, None)
        grid = EvidenceMap(0.25, sensor=sensor, ndim=2 if scan is flat else 3)
        assert add_scans(grid, [scan], method=method).skipped == {reason: 1}, (kind, method)
        assert usable_beams([scan], sensor, 0.25)[2] == {reason: 1}
