# SPDX-License-Identifier: Apache-2.0
"""Full-map estimation: exactness, speed, growth, threads, latency, memory, accuracy.

    python benchmarks/full_map.py                      # all of it, about ten minutes
    python benchmarks/full_map.py --quick              # about one minute
    python benchmarks/full_map.py --part speed --json result.json
    python benchmarks/full_map.py --part accuracy --data DIR

Every answer is checked before any time is taken. Logs are simulated in the true geometry of a
grid, not by the estimator's own model: one room of 15 x 15 m, repeated side by side as often as
beams are needed.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import math
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.lidar2d import machine, show
from benchmarks.sonar_accuracy import CASES, score_all
from oddsmap import Pose2, Scan
from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.forward.beam_rows import list_rows
from oddsmap.forward.cell_grid import CellField
from oddsmap.full_map.belief_propagation import Propagation
from oddsmap.full_map.estimator import build_full_map
from oddsmap.full_map.online import OnlineFullMap
from oddsmap.kernels.infer.beam_factor import NAT, BeamRows, passing_messages
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.usable_beams import usable_beams
from oddsmap.simulate import Sonar2D

RESOLUTION = 0.1
ROOM = 150
SEED = 20261122
SENSOR = ConeSensor(cone_deg=25.0, range_max=4.0, p_random=0.03, p_dropout=0.03)
PARTS = ("speed", "online", "memory", "accuracy")
Result = dict[str, object]


# ---- readings --------------------------------------------------------------------------------


def room() -> npt.NDArray[np.bool_]:
    """A walled room with boxes in it, True where a cell is occupied."""
    rng = np.random.default_rng(SEED)
    truth = np.ones((ROOM, ROOM), np.bool_)
    truth[1:-1, 1:-1] = False
    for x, y, width, height in rng.integers((8, 8, 3, 3), (130, 130, 18, 18), (25, 4)):
        truth[y : y + height, x : x + width] = True
    return truth


def walk(truth: npt.NDArray[np.bool_], pose_count: int) -> list[Pose2]:
    """Poses that go round and round through the room, 0.1 m apart, off what stands there."""
    wide = truth.copy()
    for axis, step in itertools.product((0, 1), (-2, -1, 1, 2)):
        wide |= np.roll(truth, step, axis)
    angle = np.arange(40 * pose_count) * 0.02
    radius = 4.5 + 2.0 * np.sin(angle * 0.173)
    x, y = 7.5 + radius * np.cos(angle), 7.5 + radius * np.sin(angle)
    free = ~wide[(y / RESOLUTION).astype(int), (x / RESOLUTION).astype(int)]
    chosen = np.flatnonzero(free)[:pose_count]
    return [Pose2(float(x[i]), float(y[i]), float(angle[i])) for i in chosen]


def scans_of(beam_count: int) -> list[Scan]:
    """Scans of 24 beams, up to 400 in each copy of the room, in the order they were taken."""
    truth, rng = room(), np.random.default_rng(SEED)
    sonar = Sonar2D(range_max=4.0, p_random=0.03, p_dropout=0.03)
    count = -(-beam_count // sonar.beam_count)
    poses = walk(truth, 400)
    # Fewer scans are spread over the same way, so that their cones are as long on average.
    poses = [poses[i] for i in np.linspace(0, 399, min(count, 400)).astype(int)]
    once = [sonar.scan(truth, RESOLUTION, pose, rng) for pose in poses]
    side = math.isqrt(max(0, -(-count // 400) - 1)) + 1
    scans = []
    for i in range(count):
        scan, copy = once[i % 400], i // 400
        x, y, theta = dataclasses.astuple(scan.map_from_sensor)
        offset = ROOM * RESOLUTION
        pose = Pose2(x + copy % side * offset, y + copy // side * offset, theta)
        scans.append(dataclasses.replace(scan, map_from_sensor=pose))
    return scans


def rows_of(scans: list[Scan]) -> tuple[CellField, BeamRows]:
    """The beams' cells, numbered."""
    prior = FullMapConfig().prior_in(2)
    field = CellField(2, round(math.log(prior / (1.0 - prior)) * NAT))
    beams, _, _ = usable_beams(scans, SENSOR)
    return field, list_rows(field, beams, SENSOR.forward_model(), RESOLUTION)


# ---- answers ---------------------------------------------------------------------------------


def check_messages() -> str:
    """Hold messages of small cones against the sum over all maps of their cells."""
    rng = np.random.default_rng(SEED)
    model = SENSOR.forward_model()
    worst = 0.0
    for _ in range(50):
        n = int(rng.integers(1, 9))
        z = float(rng.choice([math.inf, rng.uniform(0.1, 3.9)]))
        far = min(z, 4.0) / model.bin_width_at(RESOLUTION)
        bins = np.sort(rng.integers(max(0, int(far) - 6), int(far) + 4, n)).astype(np.uint16)
        fractions = rng.uniform(0.01, 1.0, n).astype(np.float32)
        q = rng.uniform(0.001, 0.999, n)
        rows = BeamRows(
            np.array([z]), np.array([0, n]), np.arange(n, dtype=np.int32), bins, fractions
        )
        out = np.empty(n, np.int32)
        detection = np.array([model.detection])
        passing_messages(rows, q, model.noise(RESOLUTION), detection, out)
        likelihoods, none = model.bin_likelihoods(z, RESOLUTION)
        # Likelihoods of the bins behind the reach are those of any far away bin.
        given = np.append(likelihoods, np.full(8, likelihoods[-1]))[bins]
        exact = _summed_out(given, none, bins, q, model.detection * fractions.astype(np.float64))
        worst = max(worst, float(np.abs(out / NAT - exact).max()))
    if worst > 1e-6:
        raise SystemExit(f"a message differs from the sum over all maps by {worst:.1e}")
    return f"differ from the sum over all maps by {worst:.0e} nats at most, in 50 cones"


def _summed_out(
    given: npt.NDArray[np.float64],
    none: float,
    bins: npt.NDArray[np.uint16],
    q: npt.NDArray[np.float64],
    chance: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Messages by the formula of f(m), map by map."""
    mu = np.zeros((2, len(q)))
    for m in itertools.product((0, 1), repeat=len(q)):
        f, through = 0.0, 1.0
        for k in np.unique(bins):
            here = bins == k
            silent = float(np.prod(1.0 - chance[here] * np.array(m)[here]))
            f += through * (1.0 - silent) * float(given[here][0])
            through *= silent
        f += through * none
        weights = np.where(m, q, 1.0 - q)
        for i, occupied in enumerate(m):
            mu[occupied, i] += f * np.prod(np.delete(weights, i))
    return np.asarray(np.log(mu[1] / mu[0]))


def check_threads(scans: list[Scan]) -> str:
    """One and two threads give the same bits, on either schedule that they share."""
    for schedule in ("chunks", "parallel"):
        settings = FullMapConfig(schedule=schedule, sweeps=3)
        one, two = (
            build_full_map(scans, RESOLUTION, sensor=SENSOR, settings=settings, threads=n)
            for n in (1, 2)
        )
        for a, b in zip(one.known_log_odds(), two.known_log_odds(), strict=True):
            if not np.array_equal(a, b):
                raise SystemExit(f"{schedule}: two threads give other bits than one")
    return "the same bits as one"


# ---- speed -----------------------------------------------------------------------------------


def speed(quick: bool) -> Result:
    """Nanoseconds per cell-beam edge and sweep, growth with beams, and two threads."""
    repeats = 3 if quick else 7
    sizes = (1_000, 10_000) if quick else (1_000, 10_000, 100_000)
    edge: Result = {}
    per_beam = {}
    for size in sizes:
        scans = scans_of(size)
        listed = time.process_time()
        field, rows = rows_of(scans)
        listed = time.process_time() - listed
        name = f"{size} beams, {len(rows.cells) / len(rows.readings):.0f} cells each"
        rounds = max(2, repeats // (1 + size // 50_000))
        taken = _sweeps(field, rows, ("sequential", "chunks", "parallel"), rounds)
        edges = len(rows.cells) * 1e-9
        edge[name] = {f"{s}": _times([t / edges for t in ts]) for s, ts in taken.items()}
        edge[f"{name}: listing them once"] = listed / edges
        per_beam[size] = _whole(scans) / len(rows.readings)
    ratios = {
        f"{b} beams against {a}": per_beam[b] / per_beam[a] for a, b in itertools.pairwise(sizes)
    }
    return {
        "ns of CPU time per edge and sweep, one core": edge,
        "us a beam, whole estimate of 8 sweeps": {
            f"{size} beams": 1e6 * t for size, t in per_beam.items()
        },
        "time a beam, growth (1 is linear)": ratios,
        "two threads": _two_threads(10_000 if quick else 50_000, repeats),
    }


def _sweeps(
    field: CellField, rows: BeamRows, schedules: tuple[str, ...], repeats: int
) -> dict[str, list[float]]:
    """CPU times of sweeps [s], the schedules in turn; neighbours are not told."""
    model = SENSOR.forward_model()
    works = {
        schedule: Propagation(
            field,
            rows,
            model.noise(RESOLUTION),
            np.array([model.detection]),
            FullMapConfig(schedule=schedule, coupling=0.0),
        )
        for schedule in schedules
    }
    times: dict[str, list[float]] = {schedule: [] for schedule in schedules}
    for turn in range(repeats + 1):
        for schedule, work in works.items():
            started = time.process_time()
            work.sweep()
            if turn > 0:
                times[schedule].append(time.process_time() - started)
    return times


def _whole(scans: list[Scan]) -> float:
    """CPU time of an estimate from scans to map [s], of 8 sweeps, the better of two."""
    settings = FullMapConfig(sweeps=8, tolerance=0.0)
    times = []
    for _ in range(2):
        started = time.process_time()
        build_full_map(scans, RESOLUTION, sensor=SENSOR, settings=settings)
        times.append(time.process_time() - started)
    return min(times)


def _two_threads(beam_count: int, repeats: int) -> Result:
    """Wall time of one thread over that of two, which take turns."""
    model = SENSOR.forward_model()
    result: Result = {}
    for schedule in ("parallel", "chunks"):
        walls: dict[int, list[float]] = {1: [], 2: []}
        field, rows = rows_of(scans_of(beam_count))
        settings = FullMapConfig(schedule=schedule, coupling=0.0)
        works = {
            n: Propagation(
                field, rows, model.noise(RESOLUTION), np.array([model.detection]), settings, n
            )
            for n in (1, 2)
        }
        for turn, (threads, work) in itertools.product(range(repeats + 1), works.items()):
            started = time.perf_counter()
            work.sweep()
            if turn > 0:
                walls[threads].append(time.perf_counter() - started)
        best = {n: min(times) for n, times in walls.items()}
        middle = {n: statistics.median(times) for n, times in walls.items()}
        result[f'"{schedule}", x one'] = {
            "best": best[1] / best[2],
            "median": middle[1] / middle[2],
        }
    return result


def _times(values: list[float]) -> dict[str, float]:
    return {"best": min(values), "median": statistics.median(values)}


# ---- online, memory --------------------------------------------------------------------------


def online(quick: bool) -> Result:
    """How long the map takes to follow, CPU time scan by scan, and what it holds."""
    scans = scans_of(24 * (400 if quick else 4000))
    estimator = OnlineFullMap(Config(map=MapConfig(resolution=RESOLUTION), sensor=SENSOR))
    estimator.add_scans(scans[:1])
    times = []
    for scan in scans[1:]:
        started = time.process_time()
        estimator.add_scans([scan])
        times.append(1e3 * (time.process_time() - started))
    tenth = max(1, len(times) // 10)
    beliefs = estimator.nbytes - estimator.window_nbytes - estimator.reservoir_nbytes
    return {
        "scans of 24 beams": len(scans),
        "median [ms]": statistics.median(times),
        "95th percentile [ms]": float(np.quantile(times, 0.95)),
        "longest [ms]": max(times),
        "median of the last tenth over the first (1: the map's size does not matter)": (
            statistics.median(times[-tenth:]) / statistics.median(times[:tenth])
        ),
        "mean [ms]": statistics.fmean(times),
        "beams of the window [MB]": estimator.window_nbytes / 1e6,
        "beams of old scans [MB]": estimator.reservoir_nbytes / 1e6,
        "beliefs [MB]": beliefs / 1e6,
    }


def memory(quick: bool) -> Result:
    """A large log in a process of its own."""
    beam_count = 50_000 if quick else 1_000_000
    command = [sys.executable, str(Path(__file__)), "--large-log", str(beam_count)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found: Result = json.loads(done.stdout)
    return found


def large_log(beam_count: int) -> None:
    """Estimate the map of a large log, and print what it took as JSON."""
    scans = scans_of(beam_count)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started = time.perf_counter()
    estimate = build_full_map(scans, RESOLUTION, sensor=SENSOR, threads=2)
    wall = time.perf_counter() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    report = {
        "beams": beam_count,
        "cells observed": len(estimate.known_log_odds()[0]),
        "sweeps": estimate.sweeps,
        "converged": estimate.converged,
        "wall time, two threads [s]": wall,
        "most memory in use [GB]": peak * 1024 / 1e9,
        "of it, before the estimate [GB]": before * 1024 / 1e9,
    }
    print(json.dumps(report))


# ---- report ----------------------------------------------------------------------------------


def main() -> None:
    """Run it all, or a part."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    data = os.environ.get("ODDSMAP_DATA", str(ROOT.parent / "shared" / "data"))
    parser.add_argument("--data", type=Path, default=Path(data), help="folder with sonar_bench/")
    parser.add_argument("--json", type=Path, help="write the results there as well")
    parser.add_argument("--quick", action="store_true", help="smaller logs, one seed of each case")
    parser.add_argument("--part", action="append", choices=PARTS, help="this alone; repeatable")
    parser.add_argument("--case", action="append", choices=CASES, help="accuracy: this alone")
    parser.add_argument("--full-maps", action="store_true", help="accuracy: full maps alone")
    parser.add_argument("--large-log", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.large_log is not None:
        large_log(options.large_log)
        return
    parts: dict[str, Callable[[], object]] = {
        "speed": lambda: speed(options.quick),
        "online": lambda: online(options.quick),
        "memory": lambda: memory(options.quick),
        "accuracy": lambda: _accuracy(options),
    }
    result: Result = {
        "machine": machine(),
        "answers": {"messages": check_messages(), "two threads": check_threads(scans_of(5000))},
    }
    for part in options.part or PARTS:
        result[part] = parts[part]()
    show(result)
    if options.json is not None:
        options.json.write_text(json.dumps(result, indent=2) + "\n")


def _accuracy(options: argparse.Namespace) -> object:
    folder = options.data / "sonar_bench"
    if not folder.is_dir():
        return f"SKIPPED: {folder} is not there (--data DIR)"
    names = options.case or (CASES[:1] if options.quick else CASES)
    table = score_all(folder, names, options.quick, full_maps_alone=options.full_maps)
    return {"log loss / ECE / IoU": table}


if __name__ == "__main__":
    main()
