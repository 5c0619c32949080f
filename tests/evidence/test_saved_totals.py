# SPDX-License-Identifier: Apache-2.0
"""Totals of a saved map, shard by shard, against those of the map read whole."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.errors import InputError
from oddsmap.evidence.saved_totals import SavedTotals, read_totals
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import ONE
from oddsmap.map_files.zarr_folder import SHARD


def noise(ndim: int, part: int, *, lengths: bool = False) -> oddsmap.EvidenceMap:
    """Cells in several shards, around the origin; with lengths, some have nothing else."""
    rng = np.random.default_rng(ndim)
    votes = "beam" if lengths else "scan"
    grid = oddsmap.EvidenceMap(0.1, ndim=ndim, votes=votes, path_lengths=lengths)
    reach = 2 * SHARD[ndim]
    index = np.unique(rng.integers(-reach, reach, (500, ndim)), axis=0)
    hits, passes = rng.integers(0, 400, (2, len(index))) * (ONE // part)
    grid.add_cells(index, hits, passes)
    if grid.lengths is not None:
        grid.lengths.add_cells(index + 3, np.stack([0 * hits, 1 + passes], axis=1))
    grid.record("some.log", scans=7)
    return grid


MAPS: dict[str, Callable[[], oddsmap.EvidenceMap]] = {
    "plane": lambda: noise(2, 1),
    "space": lambda: noise(3, 1),
    "parts of votes": lambda: noise(3, 8),
    "lengths": lambda: noise(2, 8, lengths=True),
    "one cell": lambda: noise(3, 1).crop([0, 0, 0], [40, 40, 40]),
    "no cell": lambda: oddsmap.EvidenceMap(0.2, ndim=3),
}


@pytest.mark.parametrize("name", MAPS)
def test_against_the_whole_map(name: str, tmp_path: Path) -> None:
    MAPS[name]().save(tmp_path / "map.zarr")
    totals, whole = (
        read_totals(tmp_path / "map.zarr", SavedTotals),
        oddsmap.load_map(tmp_path / "map.zarr"),
    )
    census, bounds = whole.census(), whole.bounds()
    assert (totals.cells, totals.hits, totals.passes) == census[:3]
    assert str(totals.bounds) == str(bounds)
    assert totals.like.config == whole.config
    assert totals.like.provenance == whole.provenance
    assert totals.like.ndim == whole.ndim
    assert totals.like.cell_count() == 0


def test_a_map_replaced_meanwhile_counts_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, other = tmp_path / "map.zarr", noise(2, 1)
    noise(3, 1).save(path)
    real = TileStore.clear
    reads: list[TileStore] = []

    def clear(tiles: TileStore) -> None:
        real(tiles)
        if not reads:
            other.save(path, force=True)
        reads.append(tiles)

    monkeypatch.setattr(TileStore, "clear", clear)
    totals = read_totals(path, SavedTotals)
    assert len(reads) > 1
    assert (totals.cells, totals.hits) == other.census()[:2]


def test_what_is_no_map(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file or folder"):
        read_totals(tmp_path / "no.zarr", SavedTotals)
    with pytest.raises(InputError, match="not a saved map"):
        read_totals(tmp_path, SavedTotals)


def test_memory_of_a_shard(tmp_path: Path) -> None:
    def peak(shards: int) -> int:
        grid = oddsmap.EvidenceMap(0.1)
        every = np.stack(np.meshgrid(*[np.arange(256)] * 2), axis=-1).reshape(-1, 2)
        for shard in range(shards):
            grid.add_cells(every + np.array([shard * SHARD[2], 0]), *np.full((2, len(every)), ONE))
        path = tmp_path / f"{shards}.zarr"
        grid.save(path)
        read_totals(path, SavedTotals)  # compiles, and imports
        tracemalloc.start()
        assert read_totals(path, SavedTotals).cells == shards * 256**2
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    few, many = peak(4), peak(16)
    assert many - few < 12 * 256**2  # half of what the cells take
