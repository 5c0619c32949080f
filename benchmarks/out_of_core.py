# SPDX-License-Identifier: Apache-2.0
"""A map four times as large as the memory that it may take: the same bits, time and memory.

    python benchmarks/out_of_core.py                   # nine minutes of CPU, 0.3 GB of disk
    python benchmarks/out_of_core.py --towns 2 --rounds 1               # to try it

A drive of `--towns` x 100 scans of a 64 x 1024 lidar, through as many copies of the simulated town,
300 m apart, is written as a folder of PCD files. `oddsmap build` maps it at 0.1 m in memory, and
with `--memory` a quarter of what that took, each time in a process of its own; the files of the two
maps are compared byte by byte. Peaks are those of whole processes (`ru_maxrss`). "Base" is that of
the same command where the map is next to nothing: Python, its libraries, kernels, and reading.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import numpy as np

from benchmarks import lidar3d
from benchmarks.town_folder import HEADER

APART = 300.0  # [m]


def write_drive(folder: Path, towns: int, work: Path) -> None:
    """Write the scans and poses; scans of further towns are links to those of the first."""
    folder.mkdir(parents=True)
    poses = []
    scans = list(lidar3d.load_scans(lidar3d.town_scans(work), lidar3d.SCANS))
    for number, scan in enumerate(scans):
        seen = np.isfinite(scan.ranges)
        points = (scan.directions[seen] * scan.ranges[seen, None]).astype("<f4")
        header = HEADER.format(len(points)).encode()
        (folder / f"{number:06d}.pcd").write_bytes(header + points.tobytes())
    for town in range(towns):
        for number, scan in enumerate(scans):
            name = f"{town * len(scans) + number:06d}.pcd"
            if town:
                os.link(folder / f"{number:06d}.pcd", folder / name)
            pose = scan.map_from_sensor
            place = pose.translation + np.array([APART * town, 0.0, 0.0])
            poses.append(np.column_stack([pose.rotation, place]).ravel())
    np.savetxt(folder / "poses_kitti.txt", np.array(poses), fmt="%.17g")


def build(log: Path, output: Path, *words: str) -> dict[str, Any]:
    """Build a map; what the command says, its seconds, CPU seconds and peak memory."""
    command = [
        sys.executable, "-m", "oddsmap", "build", str(log), "--poses", str(log / "poses_kitti.txt"),
        "-o", str(output), "--force", "--json", "--threads", "1", *words,
    ]  # fmt: skip
    begun = time.perf_counter()
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True) as child:
        assert child.stdout is not None
        said = child.stdout.read()
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        sys.exit(f"{' '.join(command)} failed")
    facts: dict[str, Any] = json.loads(said)
    facts["wall"] = time.perf_counter() - begun
    facts["cpu"] = usage.ru_utime + usage.ru_stime
    facts["peak"] = usage.ru_maxrss * 1024
    return facts


def same_cells(one: Path, other: Path) -> bool:
    """Whether the shards of two maps are the same files, byte by byte."""

    def shards(path: Path) -> dict[str, bytes]:
        files = (file for file in path.rglob("*") if file.is_file() and file.suffix != ".json")
        return {str(file.relative_to(path)): file.read_bytes() for file in files}

    return shards(one) == shards(other)


def main() -> None:
    """Build both ways, some times in turn, and print what that took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--towns", type=int, default=10)
    parser.add_argument("--times", type=float, default=4.0, help="map by memory, default 4")
    parser.add_argument("--resolution", default="0.1", help="[m]")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--work", type=Path, help="a folder with room, for the time")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.work) as scratch:
        drive, few = Path(scratch) / "drive", Path(scratch) / "few"
        work = Path(scratch)
        write_drive(drive, options.towns, work)
        few.mkdir()
        for name in ("000000.pcd", "000001.pcd", "poses_kitti.txt"):
            shutil.copy(drive / name, few / name)
        lines = (few / "poses_kitti.txt").read_text().splitlines()[:2]
        (few / "poses_kitti.txt").write_text("\n".join(lines) + "\n")
        whole, small = Path(scratch) / "whole.zarr", Path(scratch) / "small.zarr"
        way = ("--resolution", options.resolution)
        build(few, whole, *way)  # compiles
        base = build(few, whole, "--resolution", "2")["peak"]
        found: dict[str, list[dict[str, Any]]] = {"in memory": [], "in a quarter": []}
        memory = 0
        for _ in range(options.rounds):
            found["in memory"].append(build(drive, whole, *way))
            memory = int(found["in memory"][0]["bytes_in_memory"] / options.times)
            found["in a quarter"].append(
                build(drive, small, *way, "--memory", f"{memory // 1000}kB")
            )
        first, last = found["in memory"][0], found["in a quarter"][-1]
        print(
            f"{first['scans']} scans, {first['cells_known']:,} cells, "
            f"{first['bytes_in_memory'] / 1e6:.0f} MB of tiles, "
            f"{first['bytes_on_disk'] / 1e6:.0f} MB on disk; base {base / 1e6:.0f} MB"
        )
        print(f"--memory {memory / 1e6:.0f} MB: spilled {last['spilled']}")
        print(f"the same files: {same_cells(whole, small)}")
        for name, runs in found.items():
            wall, cpu, peak = (
                statistics.median(run[key] for run in runs) for key in ("wall", "cpu", "peak")
            )
            print(
                f"{name:14s} {wall:7.1f} s wall {cpu:7.1f} s CPU {peak / 1e6:7.0f} MB peak, "
                f"{(peak - base) / 1e6:6.0f} MB above base"
            )
        ratio = [
            statistics.median(run[key] for run in found["in a quarter"])
            / statistics.median(run[key] for run in found["in memory"])
            for key in ("wall", "cpu")
        ]
        print(f"slow-down {ratio[0]:.2f} wall, {ratio[1]:.2f} CPU")


if __name__ == "__main__":
    main()
