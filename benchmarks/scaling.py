# SPDX-License-Identifier: Apache-2.0
"""Does time grow with the scans and nothing else, and memory with the map and nothing else?

    python benchmarks/scaling.py                          # some five minutes
    python benchmarks/scaling.py --quick
    python benchmarks/scaling.py --plot docs/images/scaling.png --json result.json

Real logs, driven through again and again, so that the map stays as it is: freiburg-079 (4,791
scans of 360 beams) up to 50,000 scans at 0.05 m, hall_os0 (30 scans) up to 1,000 at 0.1 m. And
many small scans: single readings of a sonar, single rays, 16 beams. Every size is a process of its
own, which counts its own CPU time from the first scan to the last, and its most memory.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import numpy as np

import oddsmap
from oddsmap import ConeSensor, EvidenceMap, Pose2, Pose3, Scan, add_scans, open_log

PLANE = (1_000, 2_000, 5_000, 10_000, 20_000, 50_000)
SPACE = (30, 100, 200, 500, 1_000)
SMALL = {"sonar": 1_000_000, "ray": 100_000, "16 beams": 100_000}


def measure(grid: EvidenceMap, scans: Iterator[Scan]) -> dict[str, float]:
    """Add scans on one thread: CPU seconds, memory and what is in the map."""
    Path("/proc/self/clear_refs").write_text("5")  # the highest mark starts here: Linux
    before = _highest_mb()
    started = time.process_time()
    report = add_scans(grid, scans, threads=1)
    seconds = time.process_time() - started
    return {
        "scans": report.scans,
        "beams": report.beams,
        "cpu_s": seconds,
        "mb_grown": _highest_mb() - before,
        "mb_map": grid.tiles.nbytes / 1e6,
        "cells": grid.cell_count(),
    }


def _highest_mb() -> float:
    status = Path("/proc/self/status").read_text()
    return float(status.split("VmHWM:")[1].split()[0]) / 1024


def repeated(log: oddsmap.Log, count: int) -> Iterator[Scan]:
    """So many scans of a log, over and over."""
    return itertools.islice(itertools.cycle(list(log)), count)


def plane(data: Path, count: int) -> dict[str, float]:
    """Scans of 360 beams in 2D."""
    log = open_log(data / "laser2d" / "freiburg-079-corrected.log.gz")
    return measure(
        EvidenceMap(0.05, sensor=oddsmap.BeamSensor(range_max=81.9)), repeated(log, count)
    )


def space(data: Path, count: int) -> dict[str, float]:
    """Scans of 25,000 beams in 3D."""
    folder = data / "lidar3d" / "hall_os0"
    log = open_log(folder, poses=folder / "poses_kitti.txt")
    return measure(EvidenceMap(0.1, ndim=3), repeated(log, count))


def small(kind: str, count: int) -> dict[str, float]:
    """Scans of one reading, or of 16 beams, along a walk of 20 m."""
    rng = np.random.default_rng(0)
    if kind == "sonar":
        ahead = np.array([[1.0, 0.0]])
        readings = rng.uniform(0.3, 4.0, (count, 1))
        scans = (
            Scan(Pose2(20 * i / count, 0.0, 0.002 * i), ahead, readings[i]) for i in range(count)
        )
        return measure(EvidenceMap(0.1, sensor=ConeSensor(cone_deg=25.0)), scans)
    beams = 16 if kind == "16 beams" else 1
    heights = np.radians(np.linspace(-15.0, 15.0, beams)) if beams > 1 else np.zeros(1)
    fan = np.stack([np.cos(heights), np.zeros(beams), np.sin(heights)], axis=1)
    readings = rng.uniform(2.0, 15.0, (count, beams))
    scans = (
        Scan(Pose3(np.array([20 * i / count, 0.0, 1.0]), _turned(0.002 * i)), fan, readings[i])
        for i in range(count)
    )
    return measure(EvidenceMap(0.1, ndim=3), scans)


def _turned(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def in_a_process(data: Path, kind: str, count: int) -> dict[str, float]:
    """The cost of one size, measured by a process of its own."""
    words = [sys.executable, __file__, "--data", str(data), "--one", kind, str(count)]
    output = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    row: dict[str, float] = json.loads(output.splitlines()[-1])
    rate = row["scans"] / row["cpu_s"]
    print(
        f"{kind}: {row['scans']:,.0f} scans in {row['cpu_s']:.2f} s of CPU, {rate:,.0f} scans/s, "
        f"{row['mb_grown']:.0f} MB more than before, of which the map {row['mb_map']:.0f} MB",
        flush=True,
    )
    return row


def plot(report: dict[str, list[dict[str, float]]], path: Path) -> None:
    """Seconds and memory over the scans."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(9, 6), layout="constrained")
    titles = {"plane": "2D, freiburg-079, 0.05 m", "space": "3D, hall_os0, 0.1 m"}
    for column, (kind, title) in enumerate(titles.items()):
        rows = report[kind]
        scans = [row["scans"] for row in rows]
        times, memory = axes[:, column]
        times.plot(scans, [row["cpu_s"] for row in rows], "o-")
        per_scan = rows[-1]["cpu_s"] / rows[-1]["scans"]
        times.plot(scans, [per_scan * count for count in scans], "k:", label="proportional")
        times.set(title=title, xlabel="scans", ylabel="CPU time [s]", ylim=(0, None))
        times.legend(frameon=False)
        memory.plot(scans, [row["mb_grown"] for row in rows], "o-", label="process grew by")
        memory.plot(scans, [row["mb_map"] for row in rows], "s--", label="the map")
        memory.set(xlabel="scans", ylabel="memory [MB]", ylim=(0, None))
        memory.legend(frameon=False)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure all sizes, or one of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=os.environ.get("ODDSMAP_DATA"))
    parser.add_argument("--quick", action="store_true", help="a twentieth of the scans")
    parser.add_argument("--plot", type=Path, metavar="FILE.png")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", nargs=2, metavar=("KIND", "SCANS"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    data = Path(options.data or ROOT.parent / "shared" / "data").resolve()
    kinds: dict[str, Callable[[int], dict[str, float]]] = {
        "plane": partial(plane, data),
        "space": partial(space, data),
        **{kind: partial(small, kind) for kind in SMALL},
    }
    if options.one:
        kind, count = options.one
        kinds[kind](10)  # compiles
        print(json.dumps(kinds[kind](int(count))))
        return
    if not data.is_dir():
        raise SystemExit(f"SKIPPED: no logs at {data}: give --data DIR")
    part = 20 if options.quick else 1
    sizes = {"plane": PLANE, "space": SPACE} | {kind: (n,) for kind, n in SMALL.items()}
    report = {
        kind: [in_a_process(data, kind, max(count // part, 1)) for count in counts]
        for kind, counts in sizes.items()
    }
    if options.plot:
        plot(report, options.plot)
    if options.json:
        machine = f"{platform.processor()}, {os.cpu_count()} cores"
        options.json.write_text(json.dumps({"machine": machine, **report}, indent=1))


if __name__ == "__main__":
    main()
