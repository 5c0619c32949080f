# SPDX-License-Identifier: Apache-2.0
"""Views read some cells at a time, against all cells at once."""

from __future__ import annotations

import dataclasses
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap.evidence import octree_order, tiles
from oddsmap.evidence.lookup import units_at
from oddsmap.kernels.units import ONE
from oddsmap.map_files.octomap_range import shift_of
from oddsmap.map_files.octomap_writer import save_octomap
from oddsmap.map_files.ply import save_ply
from oddsmap.odds import sigmoid
from oddsmap.posterior import reflection
from oddsmap.posterior.beta import beta_interval
from oddsmap.posterior.tile_leaves import TileLeaves
from tests.map_files.test_ply_writer import read_ply


def noise(
    *, ndim: int = 3, part: int = 1, tile_side: int | None = None, shift: int = 0, most: int = 4
) -> oddsmap.EvidenceMap:
    """Cells around the origin, on both sides of it, in many tiles.

    Args:
        ndim: 2 or 3.
        part: weights are whole numbers of votes divided by this.
        tile_side: of the map.
        shift: added to all indices.
        most: of the weights [votes].
    """
    rng = np.random.default_rng(ndim)
    grid = oddsmap.EvidenceMap(0.25, ndim=ndim, tile_side=tile_side)
    index = np.unique(rng.integers(-30, 30, (3000, ndim)), axis=0) + shift
    hits, passes = rng.integers(0, most * part, (2, len(index))) * (ONE // part)
    grid.add_cells(index, hits, passes)
    return grid


def prior(grid: oddsmap.EvidenceMap) -> oddsmap.LogOdds:
    """A view with a prior of its own for each cell."""
    before = grid.like()
    before.add_cells(np.array([[1] * grid.ndim, [-5] * grid.ndim]), np.array([ONE, 0]),
                     np.array([0, ONE]))  # fmt: skip
    return grid.log_odds(prior=before)


VIEWS: dict[str, Callable[[], oddsmap.LogOdds]] = {
    "whole votes": lambda: noise().log_odds(),
    "many votes": lambda: noise(most=2000).log_odds(p_hit=0.6),
    "parts of votes": lambda: noise(part=4).log_odds(clamp=(0.2, 0.9)),
    "a prior map": lambda: prior(noise()),
    "tiles that are no nodes": lambda: noise(tile_side=6).log_odds(),
    "beyond an OctoMap": lambda: noise(shift=40_000).log_odds(),
    "one cell": lambda: noise().crop([3, 3, 3], [4, 4, 4]).log_odds(),
    "no cell": lambda: oddsmap.EvidenceMap(0.25, ndim=3).log_odds(),
}


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    for function in (tiles.TileStore.parts, octree_order.octree_parts):
        monkeypatch.setattr(function, "__defaults__", (100,))


@pytest.mark.parametrize("name", VIEWS)
def test_files_of_space(name: str, tmp_path: Path) -> None:
    view = VIEWS[name]()
    whole = view.to_voxels()
    streamed = isinstance(view.leaves(), TileLeaves)
    assert streamed == (name not in ("tiles that are no nodes", "beyond an OctoMap"))
    view.save_ply(tmp_path / "a.ply")
    save_ply(whole, tmp_path / "b.ply", thresholds=view.thresholds)
    points, plain = (read_ply(tmp_path / name)[0] for name in ("a.ply", "b.ply"))
    order, rows = (np.lexsort([some[name] for name in "xyz"]) for some in (plain, points))
    assert rows.tolist() == list(range(len(points)))
    for field in plain.dtype.names or ():
        assert np.array_equal(points[field], plain[field][order])
    cells = np.stack([np.floor(points[name] / view.resolution) for name in "xyz"], axis=1)
    hits, passes = units_at(view.evidence, cells.astype(np.int64))
    assert np.array_equal(points["hits"], (hits / ONE).astype(np.float32))
    assert np.array_equal(points["passes"], (passes / ONE).astype(np.float32))
    if name == "beyond an OctoMap":
        with pytest.raises(oddsmap.InputError, match="--shift 10000 10000 10000 moves"):
            view.save_octomap(tmp_path / "a.bt")
        _check_moved(view, tmp_path)
        return
    for suffix, clamp in ((".bt", None), (".ot", None), (".ot", (0.1192, 0.971))):
        one, other = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
        view.save_octomap(one, clamp=clamp, force=True)
        save_octomap(whole, other, clamp=clamp, thresholds=view.thresholds, force=True)
        assert one.read_bytes() == other.read_bytes()


def _check_moved(view: oddsmap.LogOdds, folder: Path) -> None:
    """A map that was moved by whole tiles or cells is the file of the same map at the origin."""
    for cells in (40_000, 39_997):  # whole tiles, and not
        metres = cells * view.resolution
        index, hits, passes = view.evidence.cells()
        near = oddsmap.EvidenceMap(view.resolution, ndim=3)
        near.add_cells(index - cells, hits, passes)
        moved = view.leaves(shift_of((metres,) * 3, view.resolution))
        assert isinstance(moved, TileLeaves) == (cells % 8 == 0)
        for suffix in (".bt", ".ot"):
            one, other = folder / f"a{suffix}", folder / f"b{suffix}"
            view.save_octomap(one, shift=(metres,) * 3, force=True)
            near.log_odds().save_octomap(other, force=True)
            words = f"# shifted: add {metres:g} {metres:g} {metres:g} [m] to get the coordinates"
            assert words.encode() in one.read_bytes()
            nodes = [path.read_bytes().split(b"id OcTree")[1] for path in (one, other)]
            assert nodes[0] == nodes[1]


@pytest.mark.parametrize("name", VIEWS)
def test_cells(name: str) -> None:
    view = VIEWS[name]()
    parts = list(view.parts(sigmoid))
    assert len(parts) > 1 or name in ("one cell", "no cell")
    index, probability = view.cells()
    assert [cell for part, _ in parts for cell in part.tolist()] == index.tolist()
    assert [p for _, part in parts for p in part.tolist()] == probability.tolist()


@pytest.mark.parametrize("part", [1, 4])
@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("name", ["log odds", "a prior map", "reflection"])
def test_arrays(
    name: str, ndim: int, part: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = noise(ndim=ndim, part=part, most=300)
    index, hits, passes = grid.cells()
    view: oddsmap.LogOdds | oddsmap.Reflection = grid.log_odds()
    extra: dict[str, Any] = {}
    if name == "a prior map":
        view = prior(grid)
    if isinstance(view, oddsmap.LogOdds) and name != "reflection":
        probability = view.cells()[1]
    else:
        grid.config = dataclasses.replace(
            grid.config, map=dataclasses.replace(grid.config.map, votes="beam")
        )
        view = grid.reflection(kind="highest-density")
        _, alpha, beta = view.cells()
        lower, upper = beta_interval(alpha, beta, 0.95, "highest-density")
        total = alpha + beta
        probability, std = alpha / total, np.sqrt(alpha / total * (beta / total) / (total + 1.0))
        extra = {"std": std, "lower": lower, "upper": upper}
    view.save_npz(tmp_path / "few.npz")
    monkeypatch.setattr(reflection, "_FEW", 0)
    view.save_npz(tmp_path / "some at a time.npz")
    with (tmp_path / "plain.npz").open("wb") as file:
        np.savez_compressed(
            file, index=index, hits=hits / ONE, passes=passes / ONE,
            probability=probability.astype(np.float32), observed=np.ones(len(index), np.bool_),
            resolution=np.float64(0.25), **{k: v.astype(np.float32) for k, v in extra.items()},
        )  # fmt: skip
    expected = (tmp_path / "plain.npz").read_bytes()
    assert (tmp_path / "few.npz").read_bytes() == expected
    assert (tmp_path / "some at a time.npz").read_bytes() == expected


@pytest.mark.parametrize("options", [{}, {"prior": 0.2}, {"clamp": (0.3, 0.8)}])
@pytest.mark.parametrize("part", [1, 4])
def test_a_plane(part: int, options: dict[str, Any]) -> None:
    grid = noise(ndim=2, part=part, most=300)
    for view in (grid.log_odds(**options), grid.like().log_odds(**options), prior(grid)):
        plane = view.to_probability_map()
        assert plane.probability.tolist() == view.probability().tolist()
        assert plane.observed.tolist() == view.observed().tolist()
        box = view.bounds()
        if box is not None:
            assert plane.origin == (box[0][0] * 0.25, box[0][1] * 0.25)
            part_of_it = view.to_probability_map((box[0] + 2, box[1]))
            assert part_of_it.probability.tolist() == plane.probability[2:, 2:].tolist()


def test_a_plane_has_no_leaves() -> None:
    with pytest.raises(oddsmap.InputError, match="needs a 3D map"):
        noise(ndim=2).log_odds().leaves()


@pytest.mark.parametrize("suffix", [".bt", ".ot", ".ply", ".npz"])
def test_memory_does_not_grow_with_the_cells(suffix: str, tmp_path: Path) -> None:
    def save(side: int) -> int:
        """What an export takes at most beside the map [bytes]."""
        grid = oddsmap.EvidenceMap(0.1, ndim=3)
        index = np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3)
        hits = index.sum(axis=1) % 3 * ONE
        grid.add_cells(index, hits, ONE - hits // 2)
        view, path = grid.log_odds(), tmp_path / f"{side}{suffix}"
        write = {".ply": view.save_ply, ".npz": view.save_npz}.get(suffix, view.save_octomap)
        write(path)  # compiles, and imports
        tracemalloc.start()
        write(path, force=True)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return peak

    save(8)
    few, many = save(32), save(96)
    assert many - few < 8 * (96**3 - 32**3)
