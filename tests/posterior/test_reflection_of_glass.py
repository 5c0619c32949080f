# SPDX-License-Identifier: Apache-2.0
"""Glass and leaves: what a filter makes of them, what counting does, and what beam factors do."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import build_map
from oddsmap.kernels.beam_factor import BeamRows
from oddsmap.kernels.beta_factor import filter_beams
from oddsmap.kernels.tiles import ONE
from oddsmap.posterior.beta import beta_interval
from oddsmap.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.cone_beams import Beams
from oddsmap.sensors.forward import ForwardModel
from oddsmap.simulate import GlassScene, GlassSensor, glass_path, glass_scene

FloatArray = npt.NDArray[np.float64]

LIDAR, SONAR = GlassSensor.lidar(), GlassSensor.sonar()
# A Beta prior that holds cells to be free or solid more often than glass.
PRIOR = 0.1
POSES = {90: 600, 24: 2400}


@cache
def log(seed: int, sensor: GlassSensor) -> tuple[GlassScene, list[Scan]]:
    scene, rng = glass_scene(seed), np.random.default_rng(100 + seed)
    path = glass_path(POSES[sensor.beam_count], seed)
    return scene, [sensor.scan(scene, pose, rng) for pose in path]


def errors(
    a: FloatArray, b: FloatArray, prior: float, truth: FloatArray, which: npt.NDArray[np.bool_]
) -> tuple[float, float, int]:
    """RMSE of the mean, coverage of the shortest 95 % intervals, over cells of > 20 trials.

    Trials are a + b beyond the prior: beams that reached the cell and told something of it.
    """
    seen = which & (a + b - 2 * prior > 20.0)
    a, b, truth = a[seen], b[seen], truth[seen]
    lower, upper = beta_interval(a, b, 0.95, "highest-density")
    rmse = float(np.sqrt(np.mean((a / (a + b) - truth) ** 2)))
    return rmse, float(np.mean((lower <= truth) & (truth <= upper))), len(a)


def counted(
    scene: GlassScene, scans: list[Scan], sensor: BeamSensor | ConeSensor
) -> tuple[FloatArray, FloatArray]:
    grid = build_map(scans, scene.resolution, sensor=sensor, votes="beam")
    hits, passes = grid.region_units([0, 0], scene.reflectivity.shape[::-1])
    return 1.0 + hits.ravel() / ONE, 1.0 + passes.ravel() / ONE


def assumed_density(
    scene: GlassScene, scans: list[Scan], sensor: GlassSensor
) -> tuple[FloatArray, FloatArray]:
    # A surface lies half a cell behind the nearest point of its cell, or more where it is met
    # aslant.
    model = ForwardModel(
        cone_deg=sensor.cone_deg, range_max=sensor.range_max, detection=1.0, p_random=0.005,
        p_dropout=0.005, sigma=0.035, range_bias=0.06,
    )  # fmt: skip
    beams, _ = Beams.from_scans(scans)
    a, b = np.full((2, scene.reflectivity.size), PRIOR)
    shape = scene.reflectivity.shape
    for part, listed in model.cells(beams, scene.resolution, [0, 0], shape):
        rows = BeamRows(
            beams.ranges[part], listed.offsets, listed.cells.astype(np.int32),
            listed.bins.astype(np.uint16), listed.fractions,
        )  # fmt: skip
        order = np.arange(len(rows.readings))
        filter_beams(rows, order, model.noise(scene.resolution), np.ones(1), a, b)
    return a, b


@pytest.mark.parametrize("seed", [0, 1])
def test_counting_a_lidars_beams(seed: int) -> None:
    scene, scans = log(seed, LIDAR)
    truth = scene.reflectivity.ravel()
    a, b = counted(scene, scans, BeamSensor(range_max=LIDAR.range_max))
    rmse, _, cells = errors(a, b, 1.0, truth, truth >= 0.0)
    assert cells > 4000
    assert rmse <= 0.05
    rmse, coverage, cells = errors(a, b, 1.0, truth, (truth > 0.0) & (truth < 1.0))
    assert cells > 80
    assert rmse <= 0.05
    assert coverage >= 0.9


@pytest.mark.parametrize("seed", [0, 1])
def test_log_odds_are_certain_of_glass(seed: int) -> None:
    """What half lets beams pass is called free, or occupied, and hardly ever left open."""
    scene, scans = log(seed, LIDAR)
    grid = build_map(scans, scene.resolution, sensor=BeamSensor(range_max=LIDAR.range_max))
    region = ((0, 0), scene.reflectivity.shape[::-1])
    p = grid.log_odds().probability(region)
    hits, passes = grid.region_units(*region)
    seen = hits + passes > 20 * ONE
    thin, dense = seen & (scene.reflectivity == 0.15), seen & (scene.reflectivity == 0.6)
    assert np.mean(p[thin] < 0.01) > 0.8
    assert np.mean(p[dense] > 0.99) > 0.8


@pytest.mark.parametrize("sensor", [LIDAR, SONAR], ids=["lidar", "sonar"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_beam_factors_recover_reflectivities(seed: int, sensor: GlassSensor) -> None:
    scene, scans = log(seed, sensor)
    truth = scene.reflectivity.ravel()
    a, b = assumed_density(scene, scans, sensor)
    rmse, coverage, cells = errors(a, b, PRIOR, truth, truth >= 0.0)
    assert cells > 4000
    assert rmse <= 0.05
    assert coverage >= 0.93
    # Free cells are the easy ones: of the surfaces alone.
    rmse, coverage, cells = errors(a, b, PRIOR, truth, truth > 0.0)
    assert cells > 250
    assert rmse <= 0.05
    assert coverage >= 0.9


def test_counting_fails_under_a_cone() -> None:
    scene, scans = log(0, SONAR)
    truth = scene.reflectivity.ravel()
    surface = truth > 0.0
    sensor = ConeSensor(cone_deg=SONAR.cone_deg, range_max=SONAR.range_max)
    rmse, coverage, _ = errors(*counted(scene, scans, sensor), 1.0, truth, surface)
    better, covers, _ = errors(*assumed_density(scene, scans, SONAR), PRIOR, truth, surface)
    assert rmse > 5 * better
    assert coverage < 0.5 < covers
