# SPDX-License-Identifier: Apache-2.0
"""Glass and leaves through the public view, and the figures that docs/glass.md shows."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import BeamSensor, EvidenceMap, State, build_map
from oddsmap.simulate import GlassScene, GlassSensor, glass_path, glass_scene

DOCS = Path(__file__).resolve().parents[1] / "docs"
LIDAR = GlassSensor.lidar()


@pytest.fixture(scope="module")
def hall() -> tuple[GlassScene, EvidenceMap]:
    """A hall with glass, and the map of a lidar's beams."""
    scene, rng = glass_scene(7), np.random.default_rng(7)
    scans = [LIDAR.scan(scene, pose, rng) for pose in glass_path(400, 7)]
    sensor = BeamSensor(range_max=LIDAR.range_max)
    return scene, build_map(scans, scene.resolution, sensor=sensor, votes="beam")


def test_the_reflection_map_recovers_reflectivities(
    hall: tuple[GlassScene, EvidenceMap], record_property: Callable[[str, object], None]
) -> None:
    scene, grid = hall
    region = ((0, 0), scene.reflectivity.shape[::-1])
    view = grid.reflection()
    hits, passes = grid.region(*region)
    tried = hits + passes > 20
    truth = scene.reflectivity
    lower, upper = view.interval(region)
    for name, cells in (("all", tried), ("glass", tried & (truth > 0.0) & (truth < 1.0))):
        assert np.count_nonzero(cells) > (4000 if name == "all" else 60)
        error = view.mean(region)[cells] - truth[cells]
        inside = (lower[cells] <= truth[cells]) & (truth[cells] <= upper[cells])
        record_property(f"coverage_{name}", float(inside.mean()))
        assert np.sqrt(np.mean(error**2)) <= 0.05, name
        if name == "glass":
            assert inside.mean() >= 0.85
    # A planner that must not touch glass asks for any reflection at all.
    careful = view.p_above(region, threshold=0.05)
    assert (careful[tried & (truth > 0.0)] > 0.95).all()
    assert np.mean(careful[tried & (truth == 0.0)] > 0.95) < 0.01


def test_what_glass_is_called(hall: tuple[GlassScene, EvidenceMap]) -> None:
    """By the limit of one half: glass of 0.15 is free, and what returns all beams occupied."""
    scene, grid = hall
    region = ((0, 0), scene.reflectivity.shape[::-1])
    state, seen = grid.reflection().state(region), sum(grid.region(*region)) > 20
    assert (state[seen & (scene.reflectivity == 0.15)] == State.FREE).all()
    assert (state[seen & (scene.reflectivity == 1.0)] == State.OCCUPIED).all()
    assert (state[~grid.reflection().observed(region)] == State.UNKNOWN).all()


def figures() -> Any:
    spec = importlib.util.spec_from_file_location("figures_glass", DOCS / "figures" / "glass.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look for it there
    spec.loader.exec_module(module)
    return module


def numbers(text: str) -> tuple[str, list[float]]:
    """A text without its numbers, and these."""
    found = r"\d+(?:\.\d+)?"
    return re.sub(found, "#", text), [float(number) for number in re.findall(found, text)]


@pytest.mark.slow
def test_the_page_shows_what_its_script_finds() -> None:
    page = (DOCS / "glass.md").read_text(encoding="utf-8")
    shown = "\n".join(line for line in page.splitlines() if line.startswith("|"))
    made = figures().tables()
    words, values = numbers("\n".join(line for line in made.splitlines() if line))
    assert numbers(shown)[0] == words
    # Another machine may round a ray to the other side of a corner.
    np.testing.assert_allclose(numbers(shown)[1], values, rtol=0.02, atol=0.011)
    rmse = {name: way[0] for name, way in figures().scores((0,)).items()}
    assert rmse["lidar, counted"] <= 0.05 < rmse["sonar, counted"]
    assert rmse["sonar, beam factors"] <= 0.05
