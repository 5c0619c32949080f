# SPDX-License-Identifier: Apache-2.0
"""One process against workers of Dask on one log: wall time, CPU time, and what went between them.

    python benchmarks/dask_build.py                      # 3,000 scans, some 10 minutes
    python benchmarks/dask_build.py --scans 600 --rounds 1 --json result.json

The log is the street of `street_log.py`, 64 beams, one scan a metre, at 0.1 m. Contenders take
turns: one process with one and with two threads (`build_map`, `save`), and clusters of one and of
two processes of one thread (`scale.build`). Imports, compiled kernels and started workers come
before the clock. All maps are compared, file by file. What two processes can do on this machine at
best is shown by two that map and save one half each, each on its own. One more cluster writes to a
store behind a simulated network, of `slow_store.py`.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.slow_store import register
from benchmarks.street_log import street_log
from oddsmap import BeamSensor, EvidenceMap, build_map, open_log, scale
from oddsmap.scale.reaching import cluster_of
from oddsmap.scans.lazy_log import LazyLog
from tests.scale.conftest import files_of

Row = dict[str, float]
RESOLUTION = 0.1
FAR = {"request_s": 0.02, "mb_s": 20.0}  # as over the internet
HALVES = "2 processes, half of the log each"


def one_process(log: Path, out: Path, threads: int) -> Row:
    """Map and save in this process."""
    wall, cpu = time.perf_counter(), time.process_time()
    grid = build_map(open_log(log), RESOLUTION, threads=threads)
    grid.save(out, force=True)
    report = grid.report
    assert report is not None
    return {
        "wall_s": time.perf_counter() - wall,
        "cpu_s": time.process_time() - cpu,
        "read_s": report.read_s,
        "integrate_s": report.integrate_s,
    }


def half(log: str, out: str, first: int, past: int) -> None:
    """Map and save a half of a log in this process."""
    grid = EvidenceMap(RESOLUTION, ndim=3)
    given = open_log(log)
    assert isinstance(given, LazyLog)
    grid.add(given.between(first, past), sensor=BeamSensor(), threads=1)
    grid.save(out, force=True)


def halves(pool: ProcessPoolExecutor, log: Path, out: Path, scans: int) -> Row:
    """Map and save both halves of a log, in two processes: two maps."""
    wall, middle = time.perf_counter(), scans // 2
    jobs = [
        pool.submit(half, str(log), f"{out}{first}", first, past)
        for first, past in ((0, middle), (middle, scans))
    ]
    for job in jobs:
        job.result()
    return {"wall_s": time.perf_counter() - wall}


def on_workers(
    client: Any, log: Path, out: Path, chunk_scans: int | None, store: dict[str, float] | None
) -> Row:
    """Map on the workers of a client; with `store`, into a `SlowStore` of these options."""
    wall, cpu = time.perf_counter(), time.process_time()
    before = client.run(time.process_time)
    if store is not None and out.exists():
        shutil.rmtree(out)  # a map at a URL is not replaced
    built = scale.build(
        log, RESOLUTION, output=out if store is None else f"slow://{out}", client=client,
        force=store is None, chunk_scans=chunk_scans, store_options=store,
    )  # fmt: skip
    wall = time.perf_counter() - wall
    after = client.run(time.process_time)
    workers = sum(after.values()) - sum(before.values())
    return {
        "wall_s": wall,
        "cpu_s": workers + time.process_time() - cpu,
        "client_cpu_s": time.process_time() - cpu,
        "read_s": built.report.read_s,
        "integrate_s": built.report.integrate_s,
        "workers": len(before),
        "store_mb_s": store["mb_s"] if store else 0.0,
        "store_request_s": store["request_s"] if store else 0.0,
        "mb_of_parts": built.bytes_of_parts / 1e6,
        "chunks": built.chunk_count,
        "groups": built.group_count,
        **{f"{name}_wall_s": seconds for name, seconds in built.seconds.items()},
    }


def scheduling(client: Any, count: int = 2000) -> float:
    """Seconds that the scheduler needs for a task that does nothing."""
    started = time.perf_counter()
    client.gather(client.map(_nothing, range(count), pure=False))
    return (time.perf_counter() - started) / count


def _nothing(number: int) -> int:
    return number


def main() -> None:
    """Measure and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scans", type=int, default=3000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--chunk-scans", type=int)
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / ".cache")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    log = street_log(options.work / f"street-{options.scans}", options.scans, options.work)
    warm = street_log(options.work / "street-8", 8, options.work)
    rows: dict[str, list[Row]] = {}
    folder = Path(tempfile.mkdtemp(dir=options.work))
    task_s = 0.0
    try:
        with (
            cluster_of("local", 1) as alone,
            cluster_of("local", 2) as both,
            ProcessPoolExecutor(2, get_context("spawn")) as pool,
        ):
            contenders: dict[str, Callable[[Path, Path], Row]] = {
                "1 process, 1 thread": lambda log, out: one_process(log, out, 1),
                "1 process, 2 threads": lambda log, out: one_process(log, out, 2),
                "Dask, 1 process": lambda log, out: on_workers(
                    alone.client, log, out, options.chunk_scans, None
                ),
                "Dask, 2 processes": lambda log, out: on_workers(
                    both.client, log, out, options.chunk_scans, None
                ),
                "Dask, 2 processes, far store": lambda log, out: on_workers(
                    both.client, log, out, options.chunk_scans, FAR
                ),
            }
            register()
            both.client.run(register)
            for contender in contenders.values():
                contender(warm, folder / "warm.zarr")
            halves(pool, warm, folder / "warm", 8)
            task_s = scheduling(both.client)
            for number in range(options.rounds):
                for i, (name, contender) in enumerate(contenders.items()):
                    row = contender(log, folder / f"map{i}.zarr")
                    rows.setdefault(name, []).append(row)
                    print(number, name, json.dumps({k: round(v, 3) for k, v in row.items()}))
                row = halves(pool, log, folder / "half", options.scans)
                print(number, HALVES, json.dumps(row))
                rows.setdefault(HALVES, []).append(row)
        first, *others = (files_of(path) for path in sorted(folder.glob("map*.zarr")))
        assert all(other == first for other in others), "the maps differ"
        size = sum(len(each) for each in first.values() if isinstance(each, bytes))
        files = len(first)
    finally:
        shutil.rmtree(folder)
    medians = {
        name: {key: statistics.median(row[key] for row in of_one) for key in of_one[0]}
        for name, of_one in rows.items()
    }
    print(f"\n| {options.scans} scans | wall [s] | CPU [s] | of one thread, wall | CPU |")
    print("|---|---|---|---|---|")
    base, ceiling = medians["1 process, 1 thread"], medians.pop(HALVES)["wall_s"]
    for name, row in medians.items():
        wall, cpu = base["wall_s"] / row["wall_s"], row["cpu_s"] / base["cpu_s"]
        print(f"| {name} | {row['wall_s']:.1f} | {row['cpu_s']:.1f} | {wall:.2f} x as fast | "
              f"{cpu:.2f} x as much |")  # fmt: skip
    best = base["wall_s"] / ceiling
    print(f"| {HALVES} | {ceiling:.1f} | | {best:.2f} x as fast | |")
    read = sum(path.stat().st_size for path in log.glob("*.pcd"))
    report = {
        "machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
        "load": os.getloadavg()[0],
        "scans": options.scans,
        "mb_read": read / 1e6,
        "mb_map": size / 1e6,
        "files_map": files,
        "task_s": task_s,
        "halves_s": ceiling,
        "medians": medians,
    }
    print(json.dumps({name: value for name, value in report.items() if name != "medians"}))
    if options.json:
        options.json.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
