# SPDX-License-Identifier: Apache-2.0
"""What adding a small log to a large saved map costs: CPU time, wall time, peak memory.

    python benchmarks/append.py 4 16 48       # maps of 4 x 4 shards of a million cells, and so on

Each map is made up (every cell known), and gets 20,000 cells in its first four shards, twice: the
second time is measured, in a process of its own.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from oddsmap import EvidenceMap
from oddsmap.evidence.append import append_map
from oddsmap.evidence.store import attributes_of
from oddsmap.map_files.zarr_folder import CHUNK, SHARD, new_folder

CELL = 0.05


def make(path: Path, shards: int) -> None:
    """Save a map of so many shards along each side."""
    count = (SHARD[2] // CHUNK[2]) ** 2
    runs = np.random.default_rng(0).integers(1, 9, (count, CHUNK[2] ** 2 // 16))
    cells = np.repeat(runs, 16, axis=1).astype(np.uint8)
    side = shards * SHARD[2]
    lo, hi = np.zeros(2, np.int64), np.full(2, side)
    with new_folder(path, (side, side), force=True) as folder:
        for name in ("hits", "passes"):
            folder.create(name, np.uint8, 0, {"description": name, "weight_unit": 1.0})
            for place in np.ndindex(shards, shards):
                folder.write(name, place, np.arange(count), cells)
        folder.seal(attributes_of(EvidenceMap(CELL), lo, lo, hi))


def measure(path: Path) -> None:
    """Add to a map, and print what it took."""
    grid, rng = EvidenceMap(CELL), np.random.default_rng(1)
    index = np.unique(rng.integers(500, 1500, (20_000, 2)), axis=0)
    votes = np.full(len(index), 65536)
    grid.add_cells(index, votes, votes)
    append_map(grid, path)
    before, started = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    did = append_map(grid, path)
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_SELF)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(
        f"{did.shards_written} shards reached, {did.shards_kept} kept: "
        f"{cpu:.2f} s CPU, {wall:.2f} s, peak {after.ru_maxrss / 1000:.0f} MB"
    )


if __name__ == "__main__":
    if sys.argv[1] == "--measure":
        measure(Path(sys.argv[2]))
    else:
        for side in map(int, sys.argv[1:]):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder, "map.zarr")
                make(path, side)
                size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
                print(
                    f"{(side * SHARD[2]) ** 2:,} cells, {size / 1e6:.0f} MB: ", end="", flush=True
                )
                subprocess.run([sys.executable, __file__, "--measure", str(path)], check=True)
