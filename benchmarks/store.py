# SPDX-License-Identifier: Apache-2.0
"""What saving and loading a map costs, beside zarr-python with and without the zarrs pipeline.

    python benchmarks/store.py MAP.zarr ...        # maps that oddsmap build made
    pip install zarrs                              # else its column is left out

Writing: the arrays of the map, as oddsmap saves tiles, and as zarr-python takes dense shards (ready
made, and synced to the disk by nobody). Reading: into tiles, and into dense shards. CPU time of all
threads and wall time, the best of some rounds; the answers are compared first.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import zarr

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from oddsmap import load_map
from oddsmap.map_files.zarr_folder import shard_files

NAMES = ("hits", "passes")
PIPELINES = {
    "zarr-python": "zarr.core.codec_pipeline.BatchedCodecPipeline",
    "zarrs": "zarrs.ZarrsCodecPipeline",
}
Place = tuple[slice, ...]
DenseShard = tuple[str, Place, npt.NDArray[Any]]


def places_of(path: Path, array: zarr.Array[Any]) -> Iterator[Place]:
    """Where an array has a file."""
    assert array.shards is not None
    for place in shard_files(path, array.basename, array.ndim):
        yield tuple(slice(i * n, (i + 1) * n) for i, n in zip(place, array.shards, strict=True))


def dense_shards(path: Path) -> Iterator[DenseShard]:
    """All shards of a map, by plain Zarr."""
    root = zarr.open_group(path, mode="r")
    for name in NAMES:
        array = root[name]
        assert isinstance(array, zarr.Array)
        for at in places_of(path, array):
            yield name, at, np.asarray(array[at])


def write_dense(path: Path, like: Path, shards: list[DenseShard]) -> None:
    """The same, written by plain Zarr."""
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir()
    for name in ("", *NAMES):
        (path / name).mkdir(exist_ok=True)
        shutil.copy(like / name / "zarr.json", path / name / "zarr.json")
    root = zarr.open_group(path, mode="r+")
    for name, at, cells in shards:
        array = root[name]
        assert isinstance(array, zarr.Array)
        array[at] = cells


def best(work: Callable[[], object], rounds: int) -> str:
    """CPU and wall time of the quickest round [s]."""
    times = []
    for _ in range(rounds):
        cpu, wall = time.process_time(), time.perf_counter()
        work()
        times.append((time.process_time() - cpu, time.perf_counter() - wall))
    return f"{min(cpu for cpu, _ in times):6.2f} {min(wall for _, wall in times):6.2f}"


def measure(path: Path, rounds: int, scratch: Path) -> None:
    """Print the figures of one map."""
    grid = load_map(path)
    grid.save(scratch / "own.zarr", force=True)
    size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    print(f"{path.name}: {grid.cell_count()} cells, {grid.ndim}D, {size / 1e6:.2f} MB on disk")
    print(f"  {'':14s} written CPU, wall   read CPU, wall [s]")
    written = best(lambda: grid.save(scratch / "own.zarr", force=True), rounds)
    print(f"  {'oddsmap':14s} {written:20s} {best(lambda: load_map(path), rounds)}")
    dense, copy = list(dense_shards(path)), scratch / "dense.zarr"
    for name, pipeline in PIPELINES.items():
        try:
            zarr.config.set({"codec_pipeline.path": pipeline})
            for (_, _, one), (_, _, other) in zip(dense, dense_shards(path), strict=True):
                assert (one == other).all()
        except (ImportError, KeyError, zarr.errors.BaseZarrError) as error:
            print(f"  {name:14s} SKIPPED: {error}")
            continue
        written = best(lambda: write_dense(copy, path, dense), rounds)
        read = best(lambda: deque(dense_shards(path), maxlen=0), rounds)
        size = sum(file.stat().st_size for file in copy.rglob("*") if file.is_file())
        print(f"  {name:14s} {written:20s} {read}   ({size / 1e6:.2f} MB)")
    zarr.config.set({"codec_pipeline.path": PIPELINES["zarr-python"]})


def main() -> None:
    """Measure each map."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("maps", nargs="+", type=Path)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        for path in options.maps:
            measure(path, options.rounds, Path(scratch))


if __name__ == "__main__":
    main()
