# SPDX-License-Identifier: Apache-2.0
"""Calibration finds the parameters that readings were simulated with."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.config.full_map import FullMapConfig
from oddsmap.errors import ConfigError, InputError
from oddsmap.forward.model import ForwardModel
from oddsmap.forward.occupancy_box import Window
from oddsmap.poses.pose import Pose2
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.scans.scan import Scan
from oddsmap.scoring.calibration import Calibration, calibrate
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.overhead import OverheadSensor
from oddsmap.simulate.sonar2d import Sonar2D

CELL = 0.1
TRUE = ConeSensor(
    cone_deg=25.0, range_max=2.5, detection=0.9, p_random=0.12, p_dropout=0.08, sigma=0.03
)
START = ConeSensor(cone_deg=25.0, range_max=2.5, sigma=0.1)


def room() -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Walls around 3.6 x 3.6 m, two boxes and a pillar."""
    truth = np.zeros((40, 40), np.bool_)
    truth[[1, -2]] = truth[:, [1, -2]] = True
    truth[8:14, 10:13] = truth[25:28, 24:33] = truth[28, 9] = True
    return truth


def poses(count: int, seed: int) -> list[Pose2]:
    rng = np.random.default_rng(seed)
    ways = rng.uniform(0, 2 * math.pi, count)
    return [
        Pose2(2.0 + 0.35 * math.cos(a), 2.0 + 0.35 * math.sin(a), float(rng.uniform(-3, 3)))
        for a in ways
    ]


def drawn(model: ForwardModel, count: int = 60, seed: int = 0) -> list[Scan]:
    """Rings of 24 beams, readings drawn from the model itself."""
    rng = np.random.default_rng(seed)
    directions = Sonar2D(beam_count=24).directions
    scans = []
    for pose in poses(count, seed):
        axes = directions @ pose.rotation.T
        beams = model.simulate(
            np.tile(pose.translation, (24, 1)), axes, Window(room().astype(float), CELL), rng
        )
        scans.append(Scan(pose, directions, beams.ranges))
    return scans


def assert_found(found: Calibration, true: object, names: tuple[str, ...], times: float) -> None:
    for name in names:
        off = found.values[name] - getattr(true, name)
        assert abs(off) < times * found.errors[name], (name, found.values[name], found.errors)


def test_the_noise_is_found() -> None:
    """Within four standard errors, from a start that is far off; geometry stays as it was."""
    found = calibrate(drawn(TRUE.forward_model()), CELL, sensor=dataclasses.replace(
        START, detection=0.9), noise_only=True)  # fmt: skip
    assert found.converged
    assert_found(found, TRUE, ("p_random", "p_dropout", "sigma"), 4.0)
    assert set(found.values) == {"p_random", "p_dropout", "sigma"}
    assert (found.sensor.detection, found.edge) == (0.9, 1.0)
    assert isinstance(found.sensor, ConeSensor)
    assert (found.sensor.cone_deg, found.sensor.range_max) == (25.0, 2.5)


def test_errors_are_those_of_counting() -> None:
    """Of n beams that are plainly random or not, the share has the error sqrt(p (1 - p) / n)."""
    found = calibrate(drawn(TRUE.forward_model()), CELL, sensor=TRUE, noise_only=True)
    for name in ("p_random", "p_dropout"):
        p = found.values[name]
        assert found.errors[name] == pytest.approx(math.sqrt(p * (1 - p) / found.beams), rel=0.35)
    assert 0.03 / math.sqrt(2 * found.beams) < found.errors["sigma"] < 0.006


def test_the_width_and_the_detection_are_found() -> None:
    """From a cone three degrees too wide and a detection of 0.98."""
    start = dataclasses.replace(START, cone_deg=28.0)
    found = calibrate(drawn(TRUE.forward_model(), 90, 3), CELL, sensor=start)
    assert list(found.values) == ["cone_deg", "detection", "p_random", "p_dropout", "sigma"]
    assert found.values["cone_deg"] == pytest.approx(25.0, abs=0.7)
    assert found.values["detection"] == pytest.approx(0.9, abs=0.04)
    assert found.edge < 1.6
    assert abs(found.values["p_random"] - 0.12) < 0.015
    assert abs(found.values["p_dropout"] - 0.08) < 0.015
    assert abs(found.values["sigma"] - 0.03) < 0.006
    assert 0.0 < found.errors["cone_deg"] < 0.3
    assert 0.0 < found.errors["detection"] < 0.05


def test_the_width_is_that_of_the_geometry() -> None:
    """Readings from the true geometry, where any part of a cell inside the cone echoes.

    Without a parameter for how echoes set in at the edge the width would stand for it, and come
    out at 27 degrees.
    """
    sonar = Sonar2D(cone_deg=25.0, range_max=2.5, p_random=0.05, p_dropout=0.05)
    rng = np.random.default_rng(5)
    scans = [sonar.scan(room(), CELL, pose, rng) for pose in poses(90, 5)]
    found = calibrate(scans, CELL, sensor=START)
    assert found.values["cone_deg"] == pytest.approx(25.0, abs=0.8)
    assert found.edge > 1.6
    assert found.values["detection"] > 0.93


def test_narrow_beams_have_no_width() -> None:
    model = BeamSensor(range_max=2.5, sigma=0.02, p_random=0.06, p_dropout=0.04).forward_model()
    start = BeamSensor(range_max=2.5, sigma=0.05)
    found = calibrate(drawn(model, 60, 8), 0.1, sensor=start)
    assert list(found.values) == ["detection", "p_random", "p_dropout", "sigma"]
    assert isinstance(found.sensor, BeamSensor)
    assert abs(found.values["p_random"] - 0.06) < 0.02
    assert abs(found.values["p_dropout"] - 0.04) < 0.02


def without_no_returns(scans: list[Scan]) -> list[Scan]:
    return [
        dataclasses.replace(scan, ranges=np.where(np.isfinite(scan.ranges), scan.ranges, np.nan))
        for scan in scans
    ]


def test_what_never_happens_stays_possible() -> None:
    """No-returns of open space alone: the rate stays above 0, at its bound, without an error."""
    model = dataclasses.replace(TRUE, p_dropout=0.0, detection=1.0).forward_model()
    scans = without_no_returns(drawn(model, 20))
    outdoors = Scan(Pose2(500.0, 500.0, 0.0), np.array([[1.0, 0.0]]), np.array([np.inf]))
    found = calibrate(
        [*scans, outdoors], CELL, sensor=START, noise_only=True, settings=FullMapConfig(prior=0.1)
    )
    assert found.values["p_dropout"] == 1e-4
    assert math.isnan(found.errors["p_dropout"])
    assert "p_dropout = 0.0001  # at its bound" in found.to_toml()
    assert found.notes == ()


@pytest.mark.parametrize("kept", [0.02, 0.3])
def test_without_no_returns_nothing_is_said_of_dropouts(kept: float) -> None:
    scans = without_no_returns(drawn(TRUE.forward_model(), 40))
    start = dataclasses.replace(START, p_dropout=kept)
    found = calibrate(scans, CELL, sensor=start, noise_only=True)
    assert found.sensor.p_dropout == kept
    assert set(found.values) == set(found.errors) == {"p_random", "sigma"}
    assert f"p_dropout = {kept}  # as it was" in found.to_toml()
    assert found.notes == (
        f"the log has no no-returns: p_dropout cannot be told from it; kept at {kept}",
    )
    assert found.converged
    # Of the readings that came back 0.12 / 0.92 are random.
    share = found.values["p_random"] / (1.0 - kept)
    assert abs(share - 0.12 / 0.92) < 4.0 * found.errors["p_random"] / (1.0 - kept)


def test_no_returns_that_do_not_count_are_named() -> None:
    model = BeamSensor(range_max=2.5, sigma=0.02, p_dropout=0.04).forward_model()
    scans = [
        dataclasses.replace(scan, ranges=np.minimum(scan.ranges, 2.5)) for scan in drawn(model, 10)
    ]
    start = BeamSensor(range_max=2.5, sigma=0.02)
    found = calibrate(scans, CELL, sensor=start, noise_only=True)
    lost = found.skipped["beam.no_return"]
    assert lost > 0
    assert found.notes == (
        f"no no-return counts ({lost} are skipped; sensor.clear_range lets them count): p_dropout "
        "cannot be told from it; kept at 0.02",
    )
    clearing = dataclasses.replace(start, clear_range=2.5)
    assert calibrate(scans, CELL, sensor=clearing, noise_only=True).notes == ()


def test_threads_change_no_bit() -> None:
    scans = drawn(TRUE.forward_model(), 15)
    one, two = (calibrate(scans, CELL, sensor=START, noise_only=True, threads=n) for n in (1, 2))
    assert one.values == two.values
    assert one.errors == two.errors


def test_too_few_updates_are_reported() -> None:
    found = calibrate(
        drawn(TRUE.forward_model(), 15), CELL, sensor=START, noise_only=True, updates=1
    )
    assert (found.converged, found.updates) == (False, 1)


def test_the_start_is_what_the_log_says() -> None:
    scans = tuple(drawn(TRUE.forward_model(), 10))
    said = {"cone_deg": 25.0, "range_max": 2.5}
    log = LoadedLog("run.npz", "NPZ", said, Counter({"line.short": 1}), (), scans)
    steps: list[str] = []
    found = calibrate(log, CELL, noise_only=True, progress=lambda what, _: steps.append(what))
    assert isinstance(found.sensor, ConeSensor)
    assert found.skipped["line.short"] == 1
    assert steps == ["noise"] * found.updates
    assert oddsmap.calibrate is calibrate


def test_the_toml_is_a_configuration() -> None:
    found = calibrate(drawn(TRUE.forward_model(), 10), CELL, sensor=START, noise_only=True)
    values = tomllib.loads(found.to_toml())["sensor"]
    assert values.pop("kind") == "cone"
    assert ConeSensor(**values).range_max == 2.5
    for name, value in found.values.items():
        assert values[name] == pytest.approx(value, rel=1e-4)
    assert values["detection"] == 0.98


def test_wrong_input() -> None:
    with pytest.raises(ConfigError, match="calibration is for beams and cones; a sensor of kind o"):
        calibrate([], CELL, sensor=OverheadSensor())
    for method in ("gibbs", "map"):
        said = f'full_map.method = "sum-product" alone has; got "{method}"'
        with pytest.raises(ConfigError, match=said):
            calibrate([], CELL, sensor=START, settings=FullMapConfig(method=method))
    with pytest.raises(ConfigError, match="range_max is needed"):
        calibrate(drawn(TRUE.forward_model(), 1), CELL, sensor=ConeSensor(cone_deg=25.0))
    with pytest.raises(InputError, match="no usable scan"):
        calibrate([], CELL, sensor=START)
    with pytest.raises(ConfigError, match="at least 1, got 0 and 20"):
        calibrate(drawn(TRUE.forward_model(), 1), CELL, sensor=START, threads=0)
    blind = Scan(Pose2(2.0, 2.0, 0.0), np.eye(2), np.full(2, np.inf))
    with pytest.raises(InputError, match="there are no-returns only"):
        calibrate([blind], CELL, sensor=START)
    with pytest.raises(InputError, match=r"no usable scan \(2 x beam\.nan"):
        calibrate([dataclasses.replace(blind, ranges=np.full(2, np.nan))], CELL, sensor=START)


@pytest.mark.realdata
@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_benchmark_with_outliers(data_folder: Path, seed: int) -> None:
    """E7, from (0.02, 0.02, 0.12): simulated with (0.15, 0.10, 0.03)."""
    path = data_folder / "sonar_bench" / f"E7_outliers_15pc_dropout_10pc_A_seed{seed}.npz"
    start = ConeSensor(cone_deg=25.0, range_max=4.0, sigma=0.12)
    log = oddsmap.open_log(path)
    found = calibrate(log, CELL, sensor=start, threads=2)
    assert found.converged
    assert abs(found.values["p_random"] - 0.15) < 0.015
    assert abs(found.values["p_dropout"] - 0.10) < 0.015
    assert abs(found.values["sigma"] - 0.03) < 0.006
    assert abs(found.values["cone_deg"] - 25.0) < 0.6
    grid = oddsmap.build_full_map(log, CELL, sensor=found.sensor, threads=2)
    arrays = np.load(path)
    p = grid.probability(((0, 0), (150, 150)))
    scores = oddsmap.evaluate(p, arrays["truth"], arrays["scored"])
    assert scores.log_loss < 0.036
    assert scores.ece < 0.013
    assert scores.iou > 0.77
