# SPDX-License-Identifier: Apache-2.0
"""A saved map of 10^9 known cells: opened, asked, cut and drawn, in seconds and memory.

    python benchmarks/large_map.py                     # two minutes, 0.65 GB of disk for that time
    python benchmarks/large_map.py --shards 4          # a small one, to try it

The map is made up: rooms of 6 m with walls, at 0.05 m, each with its own noise of counts, in
`--shards` x `--shards` shards of 1024 x 1024 cells, all known. It is written shard by shard, and
removed in the end. Each question is asked by a process of its own, once before the clock starts,
of a small map, so that kernels are compiled. Memory is the peak of the whole process; "nothing" is
what a process has that has imported all and asked nothing.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import oddsmap
from oddsmap.config.config import Config, MapConfig
from oddsmap.map_files.zarr_folder import (
    CHUNK,
    EVIDENCE_MAP,
    FORMAT_VERSION,
    SHARD,
    NewFolder,
    new_folder,
)
from oddsmap.plot.picture import save_picture

RESOLUTION = 0.05
SIDE, INNER = SHARD[2], CHUNK[2]
ROOM = 120  # cells
REGION = 200.0  # [m]


# ---- the map ---------------------------------------------------------------------------------


def counts_of_shard(place: tuple[int, int]) -> list[npt.NDArray[np.uint8]]:
    """Hits and passes of all cells of a shard, chunk by chunk, shape (64, 128 * 128)."""
    rng = np.random.default_rng(place)
    y, x = (np.arange(i * SIDE, (i + 1) * SIDE) % ROOM for i in place)
    door = (np.abs(x[None] - 60) < 9) | (np.abs(y[:, None] - 60) < 9)
    wall = ((x[None] < 3) | (y[:, None] < 3)) & ~door
    noise = rng.integers(0, 8, (SIDE, SIDE), np.uint8)
    hits = np.where(wall, 20 + noise, noise // 7).astype(np.uint8)
    passes = np.where(wall, noise, 40 + 2 * noise).astype(np.uint8)
    across = SIDE // INNER
    return [
        kind.reshape(across, INNER, across, INNER).swapaxes(1, 2).reshape(-1, INNER * INNER)
        for kind in (hits, passes)
    ]


def write(path: Path, shards: int) -> None:
    """Write the map, a shard at a time."""
    cells = shards * SIDE
    config = Config(map=MapConfig(resolution=RESOLUTION, votes="scan"))
    numbers = np.arange((SIDE // INNER) ** 2)
    with new_folder(path, (cells, cells), force=True) as folder:
        for name in ("hits", "passes"):
            folder.create(name, np.uint8, 0, {"description": name, "weight_unit": 1.0})
        for place in np.ndindex(shards, shards):
            _write_shard(folder, (place[0], place[1]), numbers)
        folder.seal(
            {
                "format": EVIDENCE_MAP,
                "format_version": FORMAT_VERSION,
                "resolution": RESOLUTION,
                "origin": [0.0, 0.0],
                "origin_cell": [0, 0],
                "known_cells_lo": [0, 0],
                "known_cells_hi": [cells, cells],
                "votes": "scan",
                "config": config.to_dict(),
                "provenance": [],
            }
        )


def _write_shard(folder: NewFolder, place: tuple[int, int], numbers: npt.NDArray[np.int64]) -> None:
    for name, chunks in zip(("hits", "passes"), counts_of_shard(place), strict=True):
        folder.write(name, place, numbers, chunks)


# ---- what is asked ---------------------------------------------------------------------------


def nothing(path: Path) -> str:
    """Import, and end."""
    return ""


def opening(path: Path) -> str:
    """Open, and say what it is."""
    return repr(oddsmap.EvidenceMap.open(path)).split(", ", 1)[1]


def near_points(path: Path) -> str:
    """A thousand points within 20 m."""
    points = np.random.default_rng(0).uniform(0.0, 20.0, (1000, 2))
    saved = oddsmap.EvidenceMap.open(path)
    return f"{np.count_nonzero(saved.states_at(points).state == oddsmap.State.OCCUPIED)} occupied"


def far_points(path: Path) -> str:
    """A thousand points anywhere."""
    saved = oddsmap.EvidenceMap.open(path)
    lo, hi = (np.asarray(end) * saved.resolution for end in saved.bounds() or ((0, 0), (1, 1)))
    points = np.random.default_rng(0).uniform(lo, hi, (1000, 2))
    return f"{np.count_nonzero(saved.states_at(points).state == oddsmap.State.OCCUPIED)} occupied"


def region(path: Path) -> str:
    """A region of 200 x 200 m as a ROS map."""
    part = oddsmap.EvidenceMap.open(path).crop_box((30.0, 20.0), (30.0 + REGION, 20.0 + REGION))
    part.log_odds().save_ros(path.parent / "region.yaml", force=True)
    return f"{part.cell_count():,} cells"


def picture(path: Path) -> str:
    """The whole map in a picture."""
    zoom = oddsmap.EvidenceMap.open(path).overview(2000)
    save_picture(zoom, path.parent / "whole.png", force=True, title="rooms of 6 m")
    return f"{' x '.join(map(str, zoom.observed.shape))} blocks of {zoom.resolution:g} m"


def info(path: Path) -> str:
    """`oddsmap info`, which counts all cells."""
    from oddsmap.cli.info import _of_map

    return f"{_of_map(path)['cells known']:,} cells known"


ASKED: dict[str, Callable[[Path], str]] = {
    "nothing": nothing,
    "open": opening,
    "1000 points, near": near_points,
    "1000 points, anywhere": far_points,
    "export 200 x 200 m": region,
    "picture of all": picture,
    "info": info,
}


def child(name: str, path: Path, small: Path) -> None:
    """Ask one question, and print what it took."""
    ASKED[name](small)
    begun, cpu = time.perf_counter(), time.process_time()
    said = ASKED[name](path)
    facts = {
        "wall": time.perf_counter() - begun,
        "cpu": time.process_time() - cpu,
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        "said": said,
    }
    print(json.dumps(facts))


def main() -> None:
    """Write the map, ask, and remove it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shards", type=int, default=31, help="along each side, default 31")
    parser.add_argument("--work", type=Path, help="a folder with room for the map")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        name, path, small = options.child
        child(name, Path(path), Path(small))
        return
    with tempfile.TemporaryDirectory(dir=options.work) as scratch:
        path, small = Path(scratch) / "large.zarr", Path(scratch) / "small.zarr"
        write(small, 1)
        begun = time.perf_counter()
        write(path, options.shards)
        size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
        cells = (options.shards * SIDE) ** 2
        print(
            f"{cells:,} known cells in {options.shards**2} shards, {size / 1e9:.2f} GB on disk, "
            f"written in {time.perf_counter() - begun:.0f} s, {os.cpu_count()} cores"
        )
        print(f"{'':22s} {'wall [s]':>9s} {'CPU [s]':>8s} {'peak [MB]':>9s}")
        for name in ASKED:
            words = [sys.executable, __file__, "--child", name, str(path), str(small)]
            done = subprocess.run(words, capture_output=True, text=True, check=True)
            facts = json.loads(done.stdout.splitlines()[-1])
            print(
                f"{name:22s} {facts['wall']:9.2f} {facts['cpu']:8.2f} {facts['peak'] / 1e6:9.0f}"
                f"   {facts['said']}",
                flush=True,
            )


if __name__ == "__main__":
    main()
