# SPDX-License-Identifier: Apache-2.0
"""A drive in a bag on workers of Dask: where its CPU time goes, and how workers share it.

    python benchmarks/dask_bags.py                            # 200 clouds as MCAP, some minutes
    python benchmarks/dask_bags.py --container bag --scans 400
    python benchmarks/dask_bags.py --log DRIVE.bag --resolution 0.05 --scan-topic /scan

The drive is the street of `street_log.py`: clouds of 60,000 points with a time each, 1.3 MB, one a
metre and ten a second, and transforms at 50 Hz. Times are of the processor: with as many cores as
workers the one that has the most to do decides how long it takes. Maps are compared, file by file.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import numpy as np

from benchmarks.street_log import LIDAR, SEED, street
from oddsmap import BeamSensor, Pose3, build_map, open_log, scale
from oddsmap.recordings.poses import TF_TYPES
from oddsmap.recordings.ros_recording import open_ros_recording
from oddsmap.scale.reaching import cluster_of
from tests.recordings.bags import Messages, Said
from tests.scale.conftest import files_of

CLOUDS, START, SECOND = 50, 1_700_000_000 * 10**9, 10**9
POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity", "time")])


def said(messages: Messages, scans: int) -> Iterator[Said]:
    """The drive; after some clouds the street is that of the first again."""
    world, rng = street(), np.random.default_rng(SEED)
    tables = []
    for number in range(min(CLOUDS, scans)):
        pose = Pose3(np.array([float(number), 0.0, 1.8]), np.eye(3))
        scan = LIDAR.scan(world, pose, rng, returns_only=True)
        table = np.zeros(scan.size, POINT)
        table["x"], table["y"], table["z"] = (scan.directions * scan.ranges[:, None]).T
        table["time"] = np.linspace(0.0, 0.1, scan.size)
        tables.append(table)
    fixed = messages.transform(START, "base_link", "lidar", (0.0, 0.0, 1.8), 0.0)
    yield "/tf_static", START, messages.tf(fixed)
    for k in range(5 * scans + 10):
        now = START + k * SECOND // 50
        moved = messages.transform(now, "map", "base_link", (k / 5, 0.0, 0.0), 0.0)
        yield "/tf", now, messages.tf(moved)
        if k % 5 == 0 and k < 5 * scans:
            cloud = messages.cloud(now, "lidar", tables[k // 5 % len(tables)])
            yield "/points", now + SECOND // 10, cloud


def split(log_path: Path, resolution: float, reading: dict[str, Any]) -> dict[str, float]:
    """CPU seconds of each step of reading and mapping, in this process."""
    log: Any = open_log(log_path, **reading)
    sensor = BeamSensor(range_max=log.sensor.get("range_max"))
    few = list(islice(log, 3))
    build_map(few, resolution, sensor=sensor, threads=1)  # compiles
    recording = open_ros_recording(str(log_path))
    scans = [topic.name for topic in log.topics]
    moves = [topic.name for topic in recording.topics.values() if topic.type in TF_TYPES]
    seconds: dict[str, float] = {}

    def measure(name: str, do: Callable[[], Any]) -> Any:
        before = time.process_time()
        found = do()
        seconds[name] = time.process_time() - before
        return found

    def raw() -> int:
        size = 0
        for file in recording._folder.files:
            keys = [key for key, channel in file.channels.items() if channel.topic in scans]
            size += sum(len(each[2]) for each in file.raw(keys))
        return size

    size = measure("messages of scans as bytes", raw)
    measure("the same, decoded", lambda: sum(1 for _ in recording.messages(scans)))
    measure("transforms, decoded", lambda: sum(1 for _ in recording.messages(moves)))
    log = measure("opening the log", lambda: open_log(log_path, **reading))
    kept = measure("scans with poses", lambda: list(log))
    plain = open_log(log_path, **{**reading, "deskew": False})
    measure("scans with poses, not deskewed", lambda: sum(1 for _ in plain))
    measure("mapping them", lambda: build_map(kept, resolution, sensor=sensor, threads=1))
    print(f"{len(kept)} scans, {size / 1e6:.0f} MB of messages, {len(moves)} topics of transforms")
    return seconds


def shared(
    client: Any, log: Path, out: Path, resolution: float, reading: dict[str, Any], chunk: int | None
) -> str:
    """What each worker needs, in a line."""
    before, wall = client.run(time.process_time), time.perf_counter()
    built = scale.build(
        log, resolution, output=out, client=client, chunk_scans=chunk, reading=reading, force=True
    )
    wall, after = time.perf_counter() - wall, client.run(time.process_time)
    used = sorted((after[name] - before[name] for name in after), reverse=True)
    each = ", ".join(f"{seconds:.1f}" for seconds in used)
    return f"| {len(used)} | {built.chunk_count} | {each} | {sum(used):.1f} | {wall:.1f} |"


def main() -> None:
    """Measure and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scans", type=int, default=200)
    parser.add_argument("--container", choices=["bag", "sqlite3", "mcap"], default="mcap")
    parser.add_argument("--log", type=Path, help="a recording in place of the simulated one")
    parser.add_argument("--scan-topic")
    parser.add_argument("--frame")
    parser.add_argument("--resolution", type=float, default=0.1)
    parser.add_argument("--chunk-scans", type=int)
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / ".cache")
    options = parser.parse_args()
    options.work.mkdir(exist_ok=True)
    folder = Path(tempfile.mkdtemp(dir=options.work))
    given = {"scans": options.scan_topic, "frame": options.frame}
    reading = {name: value for name, value in given.items() if value is not None}
    try:
        messages = Messages(options.container)
        log = options.log or messages.write(folder / "street", said(messages, options.scans))
        seconds = split(log, options.resolution, reading)
        print(json.dumps({name: round(value, 3) for name, value in seconds.items()}, indent=1))
        print("| workers | chunks | CPU of each [s] | together | wall |\n|---|---|---|---|---|")
        for workers in (1, 2):
            with cluster_of("local", workers) as cluster:
                for name, chunk in (
                    ("warm", 10**9), ("whole", 10**9), ("chunks", options.chunk_scans)
                ):  # fmt: skip
                    line = shared(
                        cluster.client, log, folder / f"{name}-{workers}.zarr",
                        options.resolution, reading, chunk,
                    )  # fmt: skip
                    if name != "warm":
                        print(line, flush=True)
        first, *others = (files_of(path) for path in sorted(folder.glob("*.zarr")))
        assert all(other == first for other in others), "the maps differ"
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
