# SPDX-License-Identifier: Apache-2.0
"""Scans that are added to a map one by one make the map that they make together."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import ConeSensor, EvidenceMap, InputError, Scan
from oddsmap.simulate import Lidar3D, drive3d, town

ANGLES = np.linspace(-2.0, 2.0, 90)


def scans(count: int = 6) -> list[Scan]:
    rng = np.random.default_rng(3)
    return [
        Scan.from_angles((0.3 * i, 0.1, 0.2 * i), ANGLES, rng.uniform(1.0, 9.0, 90), stamp_s=i)
        for i in range(count)
    ]


def same(a: EvidenceMap, b: EvidenceMap) -> bool:
    (lo, hi), box = a.bounds() or (0, 0), b.bounds()
    assert box is not None
    return all(np.array_equal(p, q) for p, q in zip((lo, hi), box, strict=True)) and all(
        np.array_equal(p, q) for p, q in zip(a.region(lo, hi), b.region(lo, hi), strict=True)
    )


def test_one_by_one_all_together_and_by_build_map() -> None:
    one, all_, lazily = (EvidenceMap(0.1) for _ in range(3))
    reports = [one.add(scan) for scan in scans()]
    all_.add(scans())
    lazily.add(iter(scans()))
    built = oddsmap.build_map(scans(), 0.1)
    assert same(one, built)
    assert same(all_, built)
    assert same(lazily, built)
    assert [(report.scans, report.beams) for report in reports] == [(1, 90)] * 6
    assert one.report is not None
    assert (one.report.scans, one.report.beams) == (6, 540)


def test_in_space() -> None:
    lidar, rng = Lidar3D(), np.random.default_rng(0)
    taken = [lidar.scan(town(flat=True), pose, rng) for pose in drive3d(2)]
    grid = EvidenceMap(0.5, ndim=3)
    for scan in taken:
        grid.add(scan)
    assert same(grid, oddsmap.build_map(taken, 0.5))


def test_scans_without_a_log_are_one_source_in_the_provenance(tmp_path: Path) -> None:
    grid = EvidenceMap(0.1)
    blind = Scan.from_angles((0, 0, 0), [0.0], [np.nan])
    for scan in [*scans(), blind, blind]:
        grid.add(scan)
    entry = grid.provenance[0]
    assert len(grid.provenance) == 1
    assert (entry["scans"], entry["beams"], entry["skipped"]["beam.nan"]) == (6, 540, 2)
    grid.add(scans(), sensor=oddsmap.BeamSensor(range_max=8.0))
    assert [entry["scans"] for entry in grid.provenance] == [6, 6]
    grid.save(tmp_path / "grid.zarr")
    again = EvidenceMap.load(tmp_path / "grid.zarr")
    again.add(scans(1), sensor=oddsmap.BeamSensor(range_max=8.0))
    assert [entry["scans"] for entry in again.provenance] == [6, 7]


def test_a_log_is_named_in_the_provenance(tmp_path: Path) -> None:
    beams = np.array([[0.0, 0.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0]])
    np.savez(tmp_path / "log.npz", beams=beams)
    log = oddsmap.open_log(tmp_path / "log.npz")
    grid = EvidenceMap(0.1)
    grid.add(log)
    assert grid.provenance[0]["source"] == "log.npz"
    assert same(grid, oddsmap.build_map(log, 0.1))


def test_wide_beams_need_a_sensor_for_wide_beams() -> None:
    scan = Scan.from_cone((0, 0, 0), 0.0, 2.0, cone_deg=30)
    with pytest.raises(InputError, match=r"30 deg wide, the map's sensor is a \"beam\""):
        EvidenceMap(0.1).add(scan)
    with pytest.warns(UserWarning, match="30 deg wide, the map's sensor says 20, which counts"):
        EvidenceMap(0.1, sensor=ConeSensor(cone_deg=20)).add([scan, scan])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        EvidenceMap(0.1, sensor=ConeSensor(cone_deg=30)).add(scan)
        EvidenceMap(0.1, sensor=ConeSensor(cone_deg=30)).add(scan, sensor=ConeSensor(cone_deg=20))


def test_a_list_with_something_else_in_it_adds_nothing() -> None:
    space = Scan.from_points(np.eye(4), [[1.0, 2.0, 3.0]])
    for other, says in ((space, "scan 6 is 3D, the map 2D"), ((1, 2), "scan 6 is a tuple")):
        grid = EvidenceMap(0.1)
        wrong: list[Any] = [*scans(), other]
        with pytest.raises(InputError, match=says):
            grid.add(wrong)
        assert grid.bounds() is None
        with pytest.raises(InputError, match=says):
            grid.add(iter(wrong))
