# SPDX-License-Identifier: Apache-2.0
"""Projection of some cells at a time, against that of all cells at once."""

from __future__ import annotations

import math
import tracemalloc
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap.array_types import FloatArray
from oddsmap.evidence import tiles
from oddsmap.kernels.units import ONE
from oddsmap.projection.ground_plane import GroundPlane
from oddsmap.projection.project import Ground, Rule
from tests.naive import projection as naive

BANDS = [
    (-0.35, 0.85),
    (0.1, 0.3),
    (-math.inf, 0.0),
    (0.2, math.inf),
    (-1e300, 1e300),
    (50.0, 60.0),
]


def hill(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(0.3 * np.sin(x) + 0.1 * np.sin(y))


def slope(seed: int, shift: tuple[int, int, int] = (0, 0, 0)) -> oddsmap.EvidenceMap:
    """A tilted floor with boxes on it, and free space above, on both sides of the origin."""
    rng = np.random.default_rng(seed)
    grid = oddsmap.EvidenceMap(0.1, ndim=3)
    x, y = np.meshgrid(np.arange(-17, 20), np.arange(-12, 14))
    floor = np.floor(0.1 * x + rng.normal(0.0, 0.2, x.shape)).astype(np.int64)
    for height in range(12):
        cells = np.stack([x, y, floor + height], axis=-1)[rng.random(x.shape) < 0.8]
        index = cells.astype(np.int64) + np.array(shift)
        hits = rng.integers(0, 2, len(index)) * ONE + (3 * ONE if height == 0 else 0)
        passes = rng.integers(0, 9, len(index)) * (0 if height == 0 else ONE // 2)
        grid.add_cells(index, hits, passes)
    return grid


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiles.TileStore.parts, "__defaults__", (100,))


@pytest.mark.usefixtures("small_parts")
@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize("ground", [None, "relative", hill, "plane"])
@pytest.mark.parametrize("slab", [None, 0.4])
def test_against_all_cells_at_once(
    band: tuple[float, float], ground: Ground | str, slab: float | None
) -> None:
    rule: Rule = "largest" if slab is None else "slabs"
    for seed, shift in ((1, (0, 0, 0)), (2, (5_000_000, 50_000_000, -70))):
        view = slope(seed, shift).log_odds(prior=0.3)
        plane = GroundPlane(-0.2 + 0.1 * (shift[2] - 0.1 * shift[0]), 0.1)
        surface: Any = plane.at if ground == "plane" else ground
        voxels = view.to_voxels()
        for source, cells in ((view, view.known_log_odds()), (voxels, voxels.known_log_odds())):
            prior = 0.3 if source is view else 0.5
            expected = naive.project(*cells, 0.1, band, surface, prior, slab)
            found = oddsmap.project(source, *band, ground=surface, rule=rule, slab=slab)
            assert found.observed.tolist() == expected.observed.tolist()
            seen = expected.observed
            # Sums are the same, in the same order: their sigmoid may differ by its last bit.
            assert found.probability[seen] == pytest.approx(expected.probability[seen], rel=1e-12)
            assert set(found.probability[~seen].tolist()) <= {prior}
            assert (found.origin, found.resolution) == (expected.origin, expected.resolution)


def test_layers_beside_the_band_are_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    view = slope(3).log_odds()
    read = []
    parts = type(view).parts

    def listed(*arguments: object, **options: object) -> object:
        for index, p in parts(*arguments, **options):  # type: ignore[arg-type]
            read.append(len(index))
            yield index, p

    monkeypatch.setattr(type(view), "parts", listed)
    oddsmap.project(view, 1.2, 1.3)
    assert 0 < sum(read) < view.evidence.cell_count() / 2


def test_memory_does_not_grow_with_the_layers() -> None:
    def peak(layers: int) -> int:
        grid = oddsmap.EvidenceMap(0.1, ndim=3)
        index = np.stack(np.meshgrid(*[np.arange(64)] * 2, np.arange(layers)), axis=-1)
        weights = np.full(index.size // 3, ONE)
        grid.add_cells(index.reshape(-1, 3), weights, weights)
        view = grid.log_odds()
        oddsmap.project(view, 0.0, 100.0)  # compiles, and imports
        tracemalloc.start()
        oddsmap.project(view, 0.0, 100.0)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    few, many = peak(32), peak(256)
    assert many - few < 4 * 64 * 64 * (256 - 32)
