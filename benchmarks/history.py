# SPDX-License-Identifier: Apache-2.0
"""What a commit to a map with its history costs: CPU time, and bytes on the disk.

    python benchmarks/history.py 4 16       # maps of 4 x 4 shards of a million cells, and so on

Each map is made up (every cell known), row by row of shards, and gets 20,000 cells in its first
four shards, twice: the second time is measured. Then the newest state is loaded.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from oddsmap import EvidenceMap
from oddsmap.map_files.zarr_folder import SHARD

CELL = 0.05
TILE = 64


def row_of_shards(row: int, shards: int) -> EvidenceMap:
    """A row of shards in which every cell is known, in runs of 16."""
    grid, side = EvidenceMap(CELL, tile_side=TILE), SHARD[2] // TILE
    coords = np.stack(np.meshgrid(np.arange(shards * side), np.arange(side)), axis=-1)
    coords = coords.reshape(-1, 2) + np.array([0, row * side])
    runs = np.random.default_rng(row).integers(1, 9, (len(coords), 2, TILE**2 // 16))
    grid.tiles.fill(coords, np.repeat(runs, 16, axis=2) * 65536)
    return grid


def size_of(path: Path) -> int:
    """Bytes of all files in a folder."""
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


def measure(path: Path, shards: int) -> None:
    """Make a map, commit to it, load it, and print what that took."""
    history = EvidenceMap.history(path / "map.icechunk")
    for row in range(shards):
        history.add(row_of_shards(row, shards))
    whole = size_of(path)
    grid, rng = EvidenceMap(CELL), np.random.default_rng(1)
    index = np.unique(rng.integers(500, 1500, (20_000, 2)), axis=0)
    votes = np.full(len(index), 65536)
    grid.add_cells(index, votes, votes)
    history.add(grid)
    before, started = size_of(path), time.process_time()
    history.add(grid)
    added, grown = time.process_time() - started, size_of(path) - before
    started = time.process_time()
    loaded = history.load()
    seconds = time.process_time() - started
    loaded.save(path / "map.zarr")
    print(
        f"{loaded.cell_count():,} cells: {whole / 1e6:.1f} MB, a saved map "
        f"{size_of(path / 'map.zarr') / 1e6:.1f} MB; a commit {added:.2f} s CPU, "
        f"{grown / 1e6:.2f} MB; loading {seconds:.2f} s CPU"
    )


if __name__ == "__main__":
    for side in map(int, sys.argv[1:]):
        with tempfile.TemporaryDirectory() as folder:
            measure(Path(folder), side)
