# SPDX-License-Identifier: Apache-2.0
"""Beams per second in the plane: oddsmap against MRPT's simple rays and against plain NumPy.

    python benchmarks/lidar2d.py                      # all of it, about two minutes
    python benchmarks/lidar2d.py --quick              # a tenth of the scans, fewer repeats
    python benchmarks/lidar2d.py --data DIR --json result.json

Every answer is checked before any time is taken. Contenders take turns, so that a busy machine
slows all of them; ratios are those of the best times of one run, medians stand beside.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks import numpy_mapper
from benchmarks.peers import mrpt
from oddsmap import BeamSensor, EvidenceMap, Pose2, Scan, build_map, open_log
from oddsmap.kernels.units import ONE
from oddsmap.simulate import (
    Disc,
    FloorPlan,
    Lidar2D,
    Polygon,
    Rectangle,
    Shape,
    office_drive,
    office_plan,
    write_carmen,
)

RESOLUTION = 0.05
INTEL = Path("laser2d/intel-corrected.log.gz")
# The office is enlarged so that readings are about 6 m long on average.
SCALE = 2.4
SEED = 20240531

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]
Cell = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Case:
    """One log to map; readings that are no return (clear nothing) are +Inf.

    Args:
        name: for people.
        scans: of one sensor.
        angles: of the first and the last beam [rad].
    """

    name: str
    scans: list[Scan]
    angles: tuple[float, float]

    @property
    def beams(self) -> int:
        """Readings with a return."""
        return sum(int(np.isfinite(scan.ranges).sum()) for scan in self.scans)

    @property
    def mean_range(self) -> float:
        """Mean of the returns [m]."""
        total = sum(float(scan.ranges[np.isfinite(scan.ranges)].sum()) for scan in self.scans)
        return total / self.beams


def intel(data: Path, every: int) -> Case:
    """The Intel Research Lab log (910 scans of 180 beams)."""
    log = open_log(data / INTEL)
    limit = log.sensor["range_max"]
    scans = [
        Scan(s.map_from_sensor, s.directions, np.where(s.ranges < limit, s.ranges, np.inf))
        for s in log
    ]
    return Case("Intel log", scans[::every], (-math.pi / 2, math.pi / 2 - math.pi / 180))


def synthetic(pose_count: int) -> Case:
    """A drive through the enlarged office with 1081 beams over 270 degrees."""
    step = math.radians(0.25)
    first = math.radians(-135)
    lidar = Lidar2D(beam_count=1081, angle_min=first, angle_step=step, range_max=30.0)
    plan = FloorPlan(_enlarged(shape) for shape in office_plan().obstacles)
    rng = np.random.default_rng(SEED)
    poses = (Pose2(p.x * SCALE, p.y * SCALE, p.theta) for p in office_drive(pose_count))
    scans = [lidar.scan(plan, pose, rng) for pose in poses]
    return Case("synthetic office", scans, (first, first + 1080 * step))


def _enlarged(shape: Shape) -> Shape:
    if isinstance(shape, Rectangle):
        return Rectangle(*(SCALE * v for v in (shape.x_min, shape.y_min, shape.x_max, shape.y_max)))
    if isinstance(shape, Disc):
        return Disc(SCALE * shape.x, SCALE * shape.y, SCALE * shape.radius)
    return Polygon([(SCALE * x, SCALE * y) for x, y in shape.points])


# ---- answers ---------------------------------------------------------------------------------


def check_exact(case: Case, scan_count: int) -> str:
    """Hold some scans against exact rational arithmetic.

    A kernel may differ where a beam comes within 1/1000 of a cell of a corner, in 1 of 100,000
    passes at most; hits never.

    Returns:
        How many cells differ, of how many passes.
    """
    differing, passes = 0, 0
    for i in np.linspace(0, len(case.scans) - 1, scan_count).astype(int):
        scan = case.scans[i]
        index, *weights = build_map([scan], RESOLUTION).cells()
        ours = dict(zip(_pairs(index), _pairs(np.stack(weights, axis=1)), strict=True))
        segments, _ = BeamSensor().segments([scan])
        origin, ends = segments.origins[0] / RESOLUTION, segments.ends / RESOLUTION
        theirs, visits = _exact_scan(origin, ends)
        passes += visits
        for cell in ours.keys() | theirs.keys():
            one, other = ours.get(cell, (0, 0)), theirs.get(cell, (0, 0))
            if one != other:
                differing += 1
                if one[0] != other[0] or _corner_distance(cell, origin, ends) > 1e-3:
                    raise SystemExit(f"{case.name}, scan {i}: cell {cell} is {one}, not {other}")
    if differing > passes * 1e-5:
        raise SystemExit(f"{case.name}: {differing} cells differ in {passes} passes")
    return f"{differing} cells in {passes} passes"


def _pairs(rows: IntArray) -> list[Cell]:
    return [(one, other) for one, other in rows.tolist()]


def _exact_scan(origin: FloatArray, ends: FloatArray) -> tuple[dict[Cell, Cell], int]:
    """(hits, passes) of each cell, and how many passes the beams make, repeats counted."""
    votes: dict[Cell, Cell] = {}
    visits = 0
    for end in ends:
        cells = _exact_beam(origin, end)
        visits += len(cells)
        votes.update((cell, (0, ONE)) for cell in cells)
    votes.update((cell, (ONE, 0)) for cell in _pairs(np.floor(ends).astype(np.int64)))
    return votes, visits


def _exact_beam(start: FloatArray, end: FloatArray) -> set[Cell]:
    """Cells with positive length: those of the middles between neighbouring border crossings.

    In integers, with every number a multiple of 1/unit. (tests/naive/mapping.py looks at every
    cell of the segment's box instead, which takes minutes here.)
    """
    ratios = [Fraction(float(v)) for v in (*start, *end)]
    unit = math.lcm(*(ratio.denominator for ratio in ratios))
    x0, y0, x1, y1 = (int(ratio * unit) for ratio in ratios)
    dx, dy = x1 - x0, y1 - y0
    whole = abs(dx or 1) * abs(dy or 1)  # the end of the segment, in units of its parameter
    at = {0, whole}
    for a, b, d, other in ((x0, x1, dx, dy), (y0, y1, dy, dx)):
        if d != 0:
            borders = range(-(-min(a, b) // unit), max(a, b) // unit + 1)
            sign = abs(other or 1) * (1 if d > 0 else -1)
            at.update((border * unit - a) * sign for border in borders)
    if dx == dy == 0:
        return set()
    crossings = sorted(at)
    full = 2 * whole * unit
    cells = set()
    for one, next_one in pairwise(crossings):
        middle = one + next_one
        x = (2 * whole * x0 + middle * dx) // full
        y = (2 * whole * y0 + middle * dy) // full
        cells.add((x, y))
    cells.discard((x1 // unit, y1 // unit))
    return cells


def _corner_distance(cell: Cell, origin: FloatArray, ends: FloatArray) -> float:
    """Distance [cells] of the nearest beam to a corner of a cell."""
    corners = np.array(cell) + np.array([(0, 0), (1, 0), (0, 1), (1, 1)])
    way, to = ends - origin, corners[:, None] - origin
    length2 = np.maximum((way**2).sum(axis=1), 1e-300)
    share = np.clip((to * way).sum(axis=2) / length2, 0, 1)
    return float(np.linalg.norm(to - share[..., None] * way, axis=2).min())


def check_threads(case: Case, grid: EvidenceMap) -> None:
    """Two threads must change no bit."""
    two = build_map(case.scans, RESOLUTION, threads=2)
    for one, other in zip(grid.cells(), two.cells(), strict=True):
        if not np.array_equal(one, other):
            raise SystemExit(f"{case.name}: one and two threads differ")


def numpy_agreement(case: Case, every: int) -> float:
    """Share of the cells with evidence in which the NumPy script has the same hits and passes."""
    scans = case.scans[::every]
    grid = build_map(scans, RESOLUTION)
    lo, hi = _bounds(grid)
    dense = map_with_numpy(scans, lo, hi)
    hits, passes = grid.region(lo, hi)
    seen = (hits + passes > 0) | (dense.hits > 0) | (dense.passes > 0)
    return float(((hits == dense.hits) & (passes == dense.passes))[seen].mean())


def mrpt_agreement(grid: EvidenceMap, theirs: mrpt.Grid) -> tuple[float, float]:
    """Share of our known cells that MRPT saw too, and of those where the state is the same.

    Its cells are compared by their centres; the state is whether p is above, below or at 1/2,
    with the p_hit and p_miss of MRPT. There every beam votes.
    """
    first = np.rint(theirs.corner / RESOLUTION).astype(np.int64)
    rows, columns = theirs.probability.shape
    hits, passes = grid.region(first, first + np.array([columns, rows]))
    known = hits + passes > 0
    both = (
        known & (theirs.probability != np.float32(0.5)) & (np.abs(theirs.probability - 0.5) > 1e-3)
    )
    same = np.sign(hits - passes)[both] == np.sign(theirs.probability[both] - 0.5)
    return float(both.sum() / known.sum()), float(same.mean())


def _bounds(grid: EvidenceMap) -> tuple[IntArray, IntArray]:
    bounds = grid.bounds()
    assert bounds is not None
    return bounds


# ---- times -----------------------------------------------------------------------------------


def map_with_numpy(scans: Sequence[Scan], lo: IntArray, hi: IntArray) -> numpy_mapper.DenseMap:
    """The NumPy script's map of some scans."""
    # A cell more on either side: beams through a corner may be rounded to the other side of it.
    dense = numpy_mapper.DenseMap.covering(RESOLUTION, lo - 1, hi + 1)
    for scan in scans:
        pose = scan.map_from_sensor
        numpy_mapper.add_scan(dense, pose.translation, pose.rotation, scan.directions, scan.ranges)
    dense.hits, dense.passes = dense.hits[1:-1, 1:-1], dense.passes[1:-1, 1:-1]
    return dense


def time_in_turns(
    contenders: dict[str, tuple[int, Callable[[], float]]], repeats: int
) -> dict[str, dict[str, float]]:
    """Beams per second [M/s], best and median, of contenders (beams, function giving seconds)."""
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(repeats):
        for name, (_, run) in contenders.items():
            seconds[name].append(run())
    return {
        name: {
            "best": beams / min(seconds[name]) / 1e6,
            "median": beams / statistics.median(seconds[name]) / 1e6,
        }
        for name, (beams, _) in contenders.items()
    }


def measure(
    case: Case, peer: mrpt.Mrpt | None, repeats: int, numpy_every: int
) -> dict[str, object]:
    """Check one case, then time it."""
    grid = build_map(case.scans, RESOLUTION)
    check_threads(case, grid)
    answers: dict[str, object] = {
        "differs from exact arithmetic": check_exact(case, 3),
        "NumPy script: share of equal cells": numpy_agreement(case, numpy_every),
    }
    lo, hi = _bounds(grid)
    few = case.scans[::numpy_every]
    few_beams = sum(int(np.isfinite(scan.ranges).sum()) for scan in few)

    def ours(votes: str, threads: int) -> tuple[int, Callable[[], float]]:
        def run() -> float:
            report = build_map(case.scans, RESOLUTION, votes=votes, threads=threads).report
            assert report is not None
            return report.integrate_s

        return case.beams, run

    def with_numpy() -> float:
        started = time.perf_counter()
        map_with_numpy(few, lo, hi)
        return time.perf_counter() - started

    contenders = {
        "oddsmap": ours("scan", 1),
        "oddsmap, 2 threads": ours("scan", 2),
        "oddsmap, every beam votes": ours("beam", 1),
        "NumPy script": (few_beams, with_numpy),
    }
    if peer is not None:
        scans = peer.write(case.scans, case.angles, RESOLUTION, lo, hi)
        known, same = mrpt_agreement(grid, peer.map(scans))
        answers["MRPT: share of our known cells it knows"] = known
        answers["MRPT: of these, share in the same state"] = same
        contenders["MRPT simple rays"] = (case.beams, lambda: peer.seconds(scans))
    speed = time_in_turns(contenders, repeats)
    return {
        "scans": len(case.scans),
        "beams": case.beams,
        "mean_range_m": case.mean_range,
        "cells_known": grid.cell_count(),
        "answers": answers,
        "M beams/s": speed,
        "oddsmap is x times as fast as": {
            name: speed["oddsmap"]["best"] / speed[name]["best"]
            for name in speed
            if not name.startswith("oddsmap")
        },
    }


# ---- start-up --------------------------------------------------------------------------------

_START = """
import time; t = time.perf_counter()
import oddsmap; t1 = time.perf_counter()
import numpy as np
scan = oddsmap.Scan(oddsmap.Pose2(0, 0, 0), np.array([[1.0, 0.0]]), np.array([3.0]))
grid = oddsmap.build_map([scan], 0.05); t2 = time.perf_counter()
print(t1 - t, t2 - t1, grid.report.compile_s)
"""


def start_up(repeats: int, first: bool) -> dict[str, float | str]:
    """Wall times of fresh processes [s], the best of some."""
    times = [_start_times({}) for _ in range(repeats)]
    result: dict[str, float | str] = {
        "import oddsmap": min(t[0] for t in times),
        "first map, kernels cached": min(t[1] for t in times),
        "of it, loading kernels (compile_s)": min(t[2] for t in times),
    }
    if first:
        with tempfile.TemporaryDirectory() as cache:
            result["compiling kernels the first time (compile_s)"] = _start_times(
                {"NUMBA_CACHE_DIR": cache}
            )[2]
    result |= _command_line(repeats)
    return result


def _start_times(extra: dict[str, str]) -> list[float]:
    done = subprocess.run(
        [sys.executable, "-c", _START], env=_environment() | extra, check=True, capture_output=True
    )
    return [float(word) for word in done.stdout.split()]


def _command_line(repeats: int) -> dict[str, float | str]:
    name = "`oddsmap build` of a small log, cached"
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "small.log"
        rng = np.random.default_rng(SEED)
        lidar, plan = Lidar2D(), office_plan()
        write_carmen(log, (lidar.scan(plan, pose, rng) for pose in office_drive(50)))
        walls = []
        for i in range(repeats + 1):
            out = str(Path(folder) / f"{i}.zarr")
            command = [sys.executable, "-m", "oddsmap", "build", str(log)]
            command += ["--resolution", str(RESOLUTION), "-o", out, "--json"]
            started = time.perf_counter()
            done = subprocess.run(command, env=_environment(), capture_output=True, text=True)
            walls.append(time.perf_counter() - started)
            if done.returncode != 0:
                last = (done.stderr.strip().splitlines() or ["no message"])[-1]
                return {name: f"failed: {last}"}
        report = json.loads(done.stdout)
    if report["scans"] != 50:
        return {name: f"failed: {report['scans']} scans of 50"}
    # The first call may have compiled what is not cached yet.
    return {name: min(walls[1:])}


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(ROOT / "src")}


# ---- report ----------------------------------------------------------------------------------


def machine() -> dict[str, object]:
    """What it ran on."""
    cpu = platform.processor()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = names[0].split(":", 1)[1].strip() if names else cpu
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True
    )
    changed = subprocess.run(
        ["git", "status", "--porcelain", "src"], cwd=ROOT, capture_output=True, text=True
    )
    return {
        "date": time.strftime("%Y-%m-%d"),
        "cpu": cpu,
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0],
        "python": platform.python_version(),
        "numpy": np.__version__,
        "commit": commit.stdout.strip() + (" with changes" if changed.stdout.strip() else ""),
        "command": " ".join(["python", *sys.argv]),
    }


def show(result: object, depth: int = 0) -> None:
    """Print nested results, one figure a line."""
    assert isinstance(result, dict)
    for name, value in result.items():
        if isinstance(value, dict) and set(value) == {"best", "median"}:
            print(f"{'  ' * depth}{name}: {value['best']:.2f} (median {value['median']:.2f})")
        elif isinstance(value, dict):
            print(f"{'  ' * depth}{name}:")
            show(value, depth + 1)
        else:
            print(f"{'  ' * depth}{name}: {f'{value:.4g}' if isinstance(value, float) else value}")


def main() -> None:
    """Run it all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    data = os.environ.get("ODDSMAP_DATA", str(ROOT.parent / "shared" / "data"))
    parser.add_argument("--data", type=Path, default=Path(data), help="folder with laser2d/")
    parser.add_argument("--json", type=Path, help="write the results there as well")
    parser.add_argument("--quick", action="store_true", help="a tenth of the scans, 3 repeats")
    options = parser.parse_args()

    repeats, thinned = (3, 10) if options.quick else (9, 1)
    result: dict[str, object] = {"machine": machine()}
    with tempfile.TemporaryDirectory() as folder:
        peer, why_not = mrpt.build(Path(folder))
        result["MRPT"] = peer.version if peer else why_not
        if (options.data / INTEL).exists():
            result["Intel log"] = measure(intel(options.data, thinned), peer, repeats, 4)
        else:
            result["Intel log"] = f"SKIPPED: {options.data / INTEL} is not there (--data DIR)"
        case = synthetic(2000 // thinned)
        result[case.name] = measure(case, peer, repeats, 20 // (2 if options.quick else 1))
    result["start-up [s]"] = start_up(3 if options.quick else 5, first=not options.quick)
    show(result)
    if options.json is not None:
        options.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
