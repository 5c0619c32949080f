# SPDX-License-Identifier: Apache-2.0
"""Walls that look like mirrors are told from ordinary dropouts."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from oddsmap import ConeSensor, InputError, Pose2, Scan, open_log
from oddsmap.forward.beams import Beams
from oddsmap.scoring.calibration import calibrate
from oddsmap.scoring.mirrors import Mirrors, look_for_mirrors
from oddsmap.sensors.registry import stated_of_sensor
from oddsmap.simulate import Sonar2D

CELL = 0.1
LOW, HIGH = 0.5, 5.5
SENSOR = ConeSensor(cone_deg=25.0, range_max=4.0)


def rings(sonar: Sonar2D, mirrors: bool, count: int = 60) -> list[Scan]:
    """Scans in a square room; mirrors answer within 35 degrees of their normal only."""
    truth = np.zeros((60, 60), np.bool_)
    truth[5:55, [4, 55]] = truth[[4, 55], 4:56] = True
    rng = np.random.default_rng(3)
    scans = []
    for x, y, heading in rng.uniform((1.5, 1.5, -3.0), (4.5, 4.5, 3.0), (count, 3)):
        pose = Pose2(float(x), float(y), float(heading))
        scan = sonar.scan(truth, CELL, pose, rng)
        if mirrors:
            heard = [angle(pose, way) <= 35.0 + 12.5 for way in sonar.directions @ pose.rotation.T]
            scan = dataclasses.replace(scan, ranges=np.where(heard, scan.ranges, np.inf))
        scans.append(scan)
    return scans


def angle(pose: Pose2, way: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Between a ray and the normal of the wall that it meets [deg]."""
    to_x, to_y = (
        ((HIGH if w > 0 else LOW) - p) / w if w else math.inf
        for p, w in zip(pose.translation, way, strict=True)
    )
    return math.degrees(math.acos(abs(way[0] if to_x < to_y else way[1])))


def test_mirrors_are_told() -> None:
    found = calibrate(
        rings(Sonar2D(), mirrors=True), CELL, sensor=SENSOR, noise_only=True, updates=4
    )
    assert found.mirrors is not None
    assert found.mirrors.by_incidence
    (warning,) = found.warnings
    assert warning.startswith("the walls look like mirrors: walls are heard by ")


def test_dropouts_in_runs_are_told() -> None:
    """Six neighbours are lost together, in one of six cases."""
    rng = np.random.default_rng(0)
    scans = [
        dataclasses.replace(
            scan, ranges=np.where(np.repeat(rng.random(4) < 1 / 6, 6), np.inf, scan.ranges)
        )
        for scan in rings(Sonar2D(), mirrors=False)
    ]
    found = calibrate(scans, CELL, sensor=SENSOR, noise_only=True, updates=4)
    assert found.mirrors is not None
    assert found.mirrors.in_runs
    assert not found.mirrors.by_incidence
    assert "dropouts come in runs of neighbouring beams" in found.warnings[0]


@pytest.mark.parametrize("rates", [(0.0, 0.0), (0.05, 0.3), (0.2, 0.1)])
def test_ordinary_dropouts_and_random_readings_are_not(rates: tuple[float, float]) -> None:
    sonar = Sonar2D(p_random=rates[0], p_dropout=rates[1])
    found = calibrate(rings(sonar, mirrors=False), CELL, sensor=SENSOR, noise_only=True, updates=4)
    assert found.mirrors is not None
    assert found.warnings == ()
    assert not found.mirrors.in_runs
    assert min(found.mirrors.beams) >= 100


def wall(heard: tuple[float, float], seed: int = 0) -> Mirrors:
    """Beams onto a known wall at x = 3, head on and at 60 degrees; shares of them are heard."""
    rng = np.random.default_rng(seed)
    turn = np.repeat([0.0, math.pi / 3], 400)
    origins = np.column_stack([3.0 - np.cos(turn), rng.uniform(-2, 2, 800)])
    ways = np.column_stack([np.cos(turn), np.sin(turn)])
    ranges = np.where(rng.random(800) < np.repeat(heard, 400), 1.0, np.inf)
    y = np.arange(-60, 60)
    index = np.concatenate([np.column_stack([np.full(120, x), y]) for x in (30, 31, 32)])
    return look_for_mirrors(
        Beams(origins, ways, ranges), np.zeros(800), index, np.ones(360),
        resolution=CELL, range_max=4.0,
    )  # fmt: skip


def test_walls_are_counted_by_incidence() -> None:
    found = wall((0.9, 0.6))
    assert found.beams == (400, 400)
    assert found.head_on == pytest.approx(0.9, abs=0.05)
    assert found.aslant == pytest.approx(0.6, abs=0.08)
    assert found.by_incidence
    assert not found.in_runs
    assert "aslant" in found.warning
    assert wall((0.7, 0.7)).warning == ""
    assert wall((0.6, 0.9)).warning == ""


def test_the_correlation_is_that_of_neighbours_in_a_scan() -> None:
    """Against a loop; beams of other scans are no neighbours."""
    rng = np.random.default_rng(1)
    origins = np.repeat(rng.uniform(0, 5, (30, 2)), 8, axis=0)
    dropout = np.repeat(rng.integers(0, 2, 120), 2).astype(float)
    pairs = [
        (dropout[i], dropout[i + 1]) for i in range(239) if (origins[i] == origins[i + 1]).all()
    ]
    found = look_for_mirrors(
        Beams(origins, np.tile([1.0, 0.0], (240, 1)), np.ones(240)), dropout,
        np.empty((0, 2), np.int64), np.empty(0), resolution=CELL, range_max=4.0,
    )  # fmt: skip
    assert found.pairs == len(pairs) == 210
    assert found.correlation == pytest.approx(np.corrcoef(np.array(pairs).T)[0, 1])
    assert found.in_runs
    assert found.beams == (0, 0)
    assert not found.by_incidence


def test_too_few_beams_are_no_evidence() -> None:
    few = Mirrors(correlation=0.9, pairs=49, dropouts=0.2, head_on=1.0, aslant=0.0, beams=(49, 900))
    assert few.warning == ""
    none = Mirrors(
        correlation=math.nan,
        pairs=500,
        dropouts=0.0,
        head_on=math.nan,
        aslant=math.nan,
        beams=(0, 0),
    )
    assert none.warning == ""
    rare = dataclasses.replace(few, pairs=900, dropouts=0.04)
    assert rare.warning == ""
    assert "in runs" in dataclasses.replace(rare, dropouts=0.06).warning


@pytest.mark.realdata
@pytest.mark.parametrize(("name", "mirrors"), [("E5_every", False), ("E6_spec", True)])
def test_the_sonar_benchmark(data_folder: Path, name: str, mirrors: bool) -> None:
    """Of the simulated cases E6 alone has mirrors; every fourth scan of it is enough."""
    path = next(iter(sorted((data_folder / "sonar_bench").glob(f"{name}*seed0.npz"))), None)
    if path is None:
        raise InputError(f"no {name} in {data_folder}")
    log = open_log(path)
    said = stated_of_sensor(log)
    sensor = ConeSensor(cone_deg=said["cone_deg"], range_max=said["range_max"])
    found = calibrate(
        list(log)[:: 4 if mirrors else 1], CELL, sensor=sensor, noise_only=True, updates=4
    )
    assert bool(found.warnings) == mirrors
