# SPDX-License-Identifier: Apache-2.0
"""Are probabilities true? On real logs by held-out scans, on simulated worlds by the truth.

    python benchmarks/calibration.py --data ../shared/data            # eight real logs
    python benchmarks/calibration.py --data ../shared/data --blocks   # runs of scans held out
    python benchmarks/calibration.py --data ../shared/data --own      # single votes left out
    python benchmarks/calibration.py --data ../shared/data --fit      # how long the fits take
    python benchmarks/calibration.py --truth                          # simulated worlds

Real logs: every tenth scan is held out, or with `--blocks` every tenth of a hundred runs of scans
(of two scans each where there are fewer than 200).
Each vote of a held-out scan in a cell that the map knows is a hit or a pass; the map of the other
scans says how probable a hit is. Printed: log loss [nats] and expected calibration error of each
way to say so, and of predictions below .01 and above .99 how often it happened.

`--own`: what a map's own counts say of log odds, each vote predicted from the others of its cell,
beside the mean over all ten ways to hold out a tenth of the scans, and of the runs.

Simulated worlds: p(occupied) of each known cell against the truth. "tuned" is the best inverse
sensor model there is for that world, chosen by the truth. The curve in `posterior/count_model.py`
was chosen by the office's worlds with another seed; no town and no glass was looked at.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from oddsmap import BeamSensor, EvidenceMap, Pose2, Pose3, Scan, build_map, open_log
from oddsmap.kernels.units import ONE
from oddsmap.odds import logit, sigmoid
from oddsmap.posterior.count_pairs import count_pairs
from oddsmap.scoring.own_votes import predict_own_votes
from oddsmap.scoring.reflection import ReflectionScores, score_reflection
from oddsmap.scoring.truth import evaluate
from oddsmap.simulate import Lidar2D, Lidar3D, drive3d, office_drive, office_plan, town
from oddsmap.simulate.glass import GlassSensor, glass_path, glass_scene

LOGS = {
    "intel": ("laser2d/intel-corrected.log.gz", 0.05),
    "freiburg-079": ("laser2d/freiburg-079-corrected.log.gz", 0.05),
    "aces": ("laser2d/aces-corrected.log.gz", 0.05),
    "belgioioso": ("laser2d/belgioioso-corrected.log.gz", 0.05),
    "orebro": ("laser2d/orebro-corrected.log.gz", 0.05),
    "hku1_avia": ("lidar3d/hku1_avia", 0.2),
    "hall_os0": ("lidar3d/hall_os0", 0.2),
    "7-Scenes": ("rgbd/7scenes", 0.05),
}
BLOCKS, EVERY, SEED = 100, 10, 1

BoolArray = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]
World = tuple[EvidenceMap, BoolArray]
"""A map, and of each of its known cells, in order of `cells()`, whether it is occupied."""


# ---- real logs -------------------------------------------------------------------------------


def split(count: int, *, blocks: bool, last: int = EVERY - 1) -> BoolArray:
    """Which scans of a log are held out."""
    number = np.arange(count)
    if blocks:
        number = number * min(BLOCKS, count // 2) // count
    return np.asarray(number % EVERY == last)


def reflection(data: Path, name: str, *, blocks: bool = False) -> ReflectionScores:
    """One log's scores."""
    path, resolution = LOGS[name]
    scans: list[Any] = list(open_log(data / path))
    return scores_without(scans, split(len(scans), blocks=blocks), resolution)


def scores_without(scans: list[Any], held: BoolArray, resolution: float) -> ReflectionScores:
    """Scores of a map without some scans, by these."""
    kept, other = (list(itertools.compress(scans, which)) for which in (~held, held))
    return score_reflection(*(build_map(part, resolution, votes="scan") for part in (kept, other)))


def print_own(data: Path, names: Sequence[str]) -> None:
    """One table, in Markdown: log odds and a constant, by votes, scans and runs left out."""
    rows = []
    for name, factor in itertools.product(names, (1, 2, 4)):
        path, side = LOGS[name]
        if factor == 4 and not path.startswith("laser2d"):
            continue
        scans: list[Any] = list(open_log(data / path))
        grid = build_map(scans, side * factor, votes="scan")
        own = predict_own_votes(grid.log_odds(), count_pairs(grid))
        row = [f"{name}, {side * factor:g} m"]
        if own is not None:
            row.append(f"{own.log_odds:.4f}, {own.constant:.4f}, {_verdict(own.log_odds_fail)}")
        for blocks in (False, True):
            votes, log_odds, constant = 0.0, 0.0, 0.0
            for last in range(EVERY):
                held = split(len(scans), blocks=blocks, last=last)
                found = scores_without(scans, held, side * factor)
                votes += found.votes
                log_odds += found.votes * found.of["log odds"].log_loss
                constant += found.votes * found.of["a constant"].log_loss
            worse = log_odds > constant
            row.append(f"{log_odds / votes:.4f}, {constant / votes:.4f}, {_verdict(worse)}")
        rows.append(row)
    print_table(
        ["log odds, a constant", "single votes", "tenths of the scans", "of the runs"], rows
    )


def _verdict(worse: bool) -> str:
    return "worse" if worse else "better"


def print_reflection(data: Path, names: Sequence[str], *, blocks: bool) -> None:
    """Two tables, in Markdown."""
    first, second = [], []
    for name in names:
        begin = time.process_time()
        scores = reflection(data, name, blocks=blocks)
        row = [f"{p.log_loss:.4f}, {p.ece:.4f}" for p in scores.of.values()]
        ratio = scores.of["calibrated"].log_loss / scores.of["log odds"].log_loss
        took = f"{time.process_time() - begin:.1f} s"
        first.append([name, f"{scores.votes:,.0f}", *row, f"{ratio:.2f}", took])
        for way in ("log odds", "calibrated"):
            sure = [scores.of[way].sure_free, scores.of[way].sure_hit]
            second.append([name, way, *(_times(*which) for which in sure)])
    ways = list(scores.of)
    print_table(["log loss, ECE", "votes", *ways, "calibrated / log odds", "CPU"], first)
    print_table(["", "", "p < .01: predicted, happened", "p > .99: predicted, happened"], second)


def print_fit(data: Path) -> None:
    """How long the fits of a large map take, and where one more hit lowers p(occupied)."""
    grid = build_map(open_log(data / LOGS["hall_os0"][0]), 0.05, threads=2)
    for neighbours in (False, True):
        begin = time.process_time()
        grid.calibrated(neighbours=neighbours)
        took = time.process_time() - begin
        how = " with neighbours" if neighbours else ""
        sys.stdout.write(
            f"hall_os0, 0.05 m: {grid.cell_count():,} cells fitted{how} in {took:.2f} s CPU\n"
        )
        sys.stdout.flush()
    for name in LOGS:
        path, resolution = LOGS[name]
        if path.startswith("laser2d"):
            view = build_map(open_log(data / path), resolution).calibrated()
            counts = np.arange(61.0)
            factor = view.increment(counts[:, None], counts[None])[:, 1:]
            steps = np.diff(factor, axis=0)
            sys.stdout.write(
                f"{name}: one more hit lowers p(occupied) of {(steps < -0.01).mean():.2%} of pairs "
                f"of counts by more than .01 nats, by {max(0.0, -steps.min()):.2f} at most\n"
            )


def _times(predicted: float, happened: float, votes: float) -> str:
    return f"{predicted:.5f}, {happened:.5f} of {votes:,.0f}" if votes else "none"


# ---- worlds whose truth is known -------------------------------------------------------------


def office(noise: float = 0.0, people: int = 0, count: int = 320) -> World:
    """A drive through the office, poses off by `noise` [m], and people about the robot."""
    rng, plan, lidar = np.random.default_rng(SEED), office_plan(), Lidar2D()
    scans = []
    for number, pose in enumerate(office_drive(count)):
        scan = lidar.scan(plan, pose, rng)
        ranges = np.array(scan.ranges)
        for person in range(people):
            # Who walks stands somewhere else every third scan.
            where = np.random.default_rng((SEED, person, number // 3)).uniform(-5.0, 5.0, 2)
            ranges = in_the_way(ranges, scan.directions, where @ pose.rotation)
        x, y, turn = rng.normal(0.0, [noise, noise, noise / 5.0])
        off = Pose2(pose.x + x, pose.y + y, pose.theta + turn)
        scans.append(Scan(off, scan.directions, ranges))
    grid = build_map(scans, 0.05, sensor=BeamSensor(range_max=lidar.range_max))
    (x0, y0), (x1, y1) = grid.bounds() or ((0, 0), (1, 1))
    truth = plan.rasterise(0.05, (int(x0), int(y0)), (int(x1), int(y1)), samples=5)
    x, y = (grid.cells()[0] - (x0, y0)).T
    return grid, truth[y, x]


def in_the_way(ranges: FloatArray, directions: FloatArray, place: FloatArray) -> FloatArray:
    """Ranges with a disc of 0.3 m at a place in the sensor's frame."""
    along = directions @ place
    inside = 0.3**2 - (place @ place - along**2)
    met = along - np.sqrt(np.maximum(inside, 0.0))
    return np.where((inside > 0.0) & (met > 0.3) & (met < ranges), met, ranges)


def glass(noise: float = 0.0) -> World:
    """A hall with obstacles that reflect 15 % to 100 % of beams."""
    rng, scene, sensor = np.random.default_rng(SEED), glass_scene(SEED), GlassSensor.lidar()
    scans = []
    for pose in glass_path(600, SEED):
        scan = sensor.scan(scene, pose, rng)
        x, y = rng.normal(0.0, noise, 2)
        scans.append(Scan(Pose2(pose.x + x, pose.y + y, pose.theta), scan.directions, scan.ranges))
    grid = build_map(scans, scene.resolution, sensor=BeamSensor(range_max=sensor.range_max))
    ny, nx = scene.reflectivity.shape
    x, y = grid.cells()[0].T
    inside = (x >= 0) & (x < nx) & (y >= 0) & (y < ny)
    truth = np.zeros(len(x), np.bool_)
    truth[inside] = scene.surface[y[inside], x[inside]]
    return grid, truth


def streets(noise: float = 0.0) -> World:
    """A drive through the town with a lidar of 32 rings, cells of 0.4 m."""
    rng, world = np.random.default_rng(SEED), town(SEED)
    lidar = Lidar3D(ring_count=32, column_count=360, range_max=30.0)
    scans = []
    for pose in drive3d(40, ground=world.ground):
        scan = lidar.scan(world, pose, rng, returns_only=True)
        off = pose.translation + rng.normal(0.0, noise, 3)
        scans.append(Scan(Pose3(off, pose.rotation), scan.directions, scan.ranges))
    grid = build_map(scans, 0.4, sensor=BeamSensor(range_max=lidar.range_max))
    index = grid.cells()[0]
    truth = np.zeros(len(index), np.bool_)
    for part in itertools.product((1.0, 3.0, 5.0), repeat=3):
        left = np.flatnonzero(~truth)
        truth[left] = world.contains((index[left] + np.array(part) / 6.0) * 0.4)
    return grid, truth


WORLDS: dict[str, Callable[[], World]] = {
    "office": office,
    "office, poses 1 cm off": lambda: office(0.01),
    "office, 3 cm": lambda: office(0.03),
    "office, 5 cm": lambda: office(0.05),
    "office, people": lambda: office(people=4),
    "office, people, 3 cm": lambda: office(0.03, people=4),
    "office, 60 scans, 3 cm": lambda: office(0.03, count=60),
    "glass": glass,
    "glass, 3 cm": lambda: glass(0.03),
    "town, 3D": streets,
    "town, 3D, 5 cm": lambda: streets(0.05),
}


def tuned(hits: FloatArray, passes: FloatArray, truth: BoolArray) -> FloatArray:
    """The best fixed amounts for a hit and a pass, chosen by the truth, its share the prior."""
    prior = float(logit(truth.mean()))

    def of(amounts: tuple[float, float]) -> FloatArray:
        return np.asarray(sigmoid(prior + hits * amounts[0] - passes * amounts[1]))

    choices = itertools.product((0.1, 0.2, 0.5, 1, 2, 3, 5), (0.003, 0.01, 0.03, 0.1, 0.3, 0.6, 1))
    return of(min(choices, key=lambda amounts: evaluate(of(amounts), truth).log_loss))


def occupancy(world: World) -> Iterator[tuple[str, FloatArray]]:
    """Each way to tell p(occupied) of the known cells."""
    grid, truth = world
    _, hits, passes = (np.asarray(x) for x in grid.cells())
    h, p = hits / ONE, passes / ONE
    yield "log odds", np.asarray(sigmoid(grid.log_odds().of_votes(h, p)))
    clamped = grid.log_odds(p_hit=0.7, p_miss=0.4, prior=0.5, clamp=(0.1192, 0.971))
    yield "OctoMap's clamps", np.asarray(sigmoid(clamped.of_votes(h, p)))
    yield "tuned", tuned(h, p, truth)
    yield "calibrated", np.asarray(sigmoid(grid.calibrated().of_votes(h, p)))


def print_occupancy() -> None:
    """One table, in Markdown."""
    rows: list[list[str]] = []
    ways: list[str] = []
    for name, make in WORLDS.items():
        world = make()
        row, ways = [name, f"{world[1].mean():.3f}"], []
        for way, probability in occupancy(world):
            found = evaluate(probability, world[1])
            row.append(f"{found.log_loss:.4f}, {found.ece:.4f}, {found.iou:.3f}")
            ways.append(way)
        rows.append(row)
    print_table(["log loss, ECE, IoU", "occupied", *ways], rows)


def print_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table in Markdown."""
    for row in (head, ["---"] * len(head), *rows):
        sys.stdout.write(f"| {' | '.join(row)} |\n")
    sys.stdout.write("\n")


def main() -> None:
    """Print the tables asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="the folder with laser2d/, lidar3d/, rgbd/")
    parser.add_argument("--log", action="append", choices=LOGS, help="only this log; repeatable")
    parser.add_argument("--blocks", action="store_true", help="hold out runs of scans")
    parser.add_argument("--own", action="store_true", help="leave out single votes, scans, runs")
    parser.add_argument("--fit", action="store_true", help="time the fits")
    parser.add_argument("--truth", action="store_true", help="simulated worlds")
    options = parser.parse_args()
    if options.truth == (options.data is not None):
        parser.error("give --data DIR for real logs, or --truth for simulated worlds")
    warnings.simplefilter("ignore")
    if options.truth:
        print_occupancy()
    elif options.fit:
        print_fit(options.data)
    elif options.own:
        print_own(options.data, options.log or list(LOGS))
    else:
        print_reflection(options.data, options.log or list(LOGS), blocks=options.blocks)


if __name__ == "__main__":
    main()
