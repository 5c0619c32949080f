# SPDX-License-Identifier: Apache-2.0
"""Glass and leaves: what a filter makes of them, what counting does, and what beam factors do."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import (
    BeamSensor,
    ConeSensor,
    Reflection,
    ReflectionMap,
    Scan,
    build_map,
    build_reflection_map,
)
from oddsmap.kernels.units import ONE
from oddsmap.simulate import GlassScene, GlassSensor, glass_path, glass_scene

FloatArray = npt.NDArray[np.float64]

LIDAR, SONAR = GlassSensor.lidar(), GlassSensor.sonar()
POSES = {90: 600, 24: 2400}


@cache
def log(seed: int, sensor: GlassSensor) -> tuple[GlassScene, list[Scan]]:
    scene, rng = glass_scene(seed), np.random.default_rng(100 + seed)
    path = glass_path(POSES[sensor.beam_count], seed)
    return scene, [sensor.scan(scene, pose, rng) for pose in path]


def errors(
    view: Reflection | ReflectionMap, scene: GlassScene, which: npt.NDArray[np.bool_]
) -> tuple[float, float, int]:
    """RMSE of the mean, coverage of the shortest 95 % intervals, over cells of > 20 trials.

    Trials are what alpha and beta hold beyond the prior: beams that reached the cell and told
    something of it.
    """
    box = ((0, 0), scene.reflectivity.shape[::-1])
    alpha, beta = view.parameters(box)
    seen = which & view.observed(box) & (alpha + beta - view.a - view.b > 20.0)
    truth, mean = scene.reflectivity[seen], view.mean(box)[seen]
    lower, upper = (end[seen] for end in view.interval(box, kind="highest-density"))
    rmse = float(np.sqrt(np.mean((mean - truth) ** 2)))
    return rmse, float(np.mean((lower <= truth) & (truth <= upper))), len(truth)


def counted(scene: GlassScene, scans: list[Scan], sensor: BeamSensor | ConeSensor) -> Reflection:
    return build_map(scans, scene.resolution, sensor=sensor, votes="beam").reflection()


@cache
def estimated(seed: int, sensor: GlassSensor, method: str) -> ReflectionMap:
    """As a user would: what the sensor is, all else by default."""
    model = ConeSensor(cone_deg=sensor.cone_deg, range_max=sensor.range_max)
    scene, scans = log(seed, sensor)
    return build_reflection_map(scans, scene.resolution, sensor=model, method=method)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", [0, 1])
def test_counting_a_lidars_beams(seed: int) -> None:
    scene, scans = log(seed, LIDAR)
    truth = scene.reflectivity
    view = counted(scene, scans, BeamSensor(range_max=LIDAR.range_max))
    rmse, _, cells = errors(view, scene, truth >= 0.0)
    assert cells > 4000
    assert rmse <= 0.05
    rmse, coverage, cells = errors(view, scene, (truth > 0.0) & (truth < 1.0))
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
@pytest.mark.parametrize("method", ["ep", "adf"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_beam_factors_recover_reflectivities(seed: int, method: str, sensor: GlassSensor) -> None:
    scene, _ = log(seed, sensor)
    truth, view = scene.reflectivity, estimated(seed, sensor, method)
    rmse, coverage, cells = errors(view, scene, truth >= 0.0)
    assert cells > 4000
    assert rmse <= 0.02
    assert coverage >= 0.97
    # Free cells are the easy ones: of the surfaces alone.
    rmse, coverage, cells = errors(view, scene, truth > 0.0)
    assert cells > 250
    assert rmse <= 0.05
    assert coverage >= 0.9


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_looking_again_helps_where_it_is_hard(seed: int) -> None:
    """Cells between free and solid: nearer to the truth, and most of them in their intervals."""
    scene, _ = log(seed, SONAR)
    glass = (scene.reflectivity > 0.0) & (scene.reflectivity < 1.0)
    once, again = (errors(estimated(seed, SONAR, m), scene, glass) for m in ("adf", "ep"))
    assert again[2] > 80
    assert again[0] < 0.9 * once[0]
    assert again[1] >= 0.82


def test_a_lidar_of_rays() -> None:
    scene, scans = log(0, LIDAR)
    sensor = BeamSensor(range_max=LIDAR.range_max)
    view = build_reflection_map(scans, scene.resolution, sensor=sensor)
    rmse, coverage, cells = errors(view, scene, scene.reflectivity >= 0.0)
    assert cells > 4000
    assert rmse <= 0.02
    assert coverage >= 0.97


def test_counting_fails_under_a_cone() -> None:
    scene, scans = log(0, SONAR)
    surface = scene.reflectivity > 0.0
    sensor = ConeSensor(cone_deg=SONAR.cone_deg, range_max=SONAR.range_max)
    rmse, coverage, _ = errors(counted(scene, scans, sensor), scene, surface)
    better, covers, _ = errors(estimated(0, SONAR, "ep"), scene, surface)
    assert rmse > 5 * better
    assert coverage < 0.5 < covers


def test_the_flat_prior_draws_to_the_middle() -> None:
    """Why the default is Beta(0.05, 0.15)."""
    scene, scans = log(0, SONAR)
    sensor = ConeSensor(cone_deg=SONAR.cone_deg, range_max=SONAR.range_max)
    flat = build_reflection_map(scans, scene.resolution, sensor=sensor, a=1.0, b=1.0)
    chosen = estimated(0, SONAR, "ep")
    surface = scene.reflectivity > 0.0
    assert errors(flat, scene, surface)[0] > 1.4 * errors(chosen, scene, surface)[0]
    assert errors(flat, scene, ~surface)[1] < 0.9 < 0.98 < errors(chosen, scene, ~surface)[1]
