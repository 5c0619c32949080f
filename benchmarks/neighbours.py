# SPDX-License-Identifier: Apache-2.0
"""Do the counts around a cell help where beams are few? Held-out beams of real logs say.

    python benchmarks/neighbours.py --data ../shared/data      # minutes of CPU
    python benchmarks/neighbours.py --truth                    # a simulated office, 9 s

Every tenth scan is held out; of the others 10 % or 2 % of the beams make the map, chosen at random.
Each vote of a held-out scan is a hit or a pass, in a cell that the map knows or in one that it has
not seen. Printed of both: votes, and log loss [nats], AUC and ECE of the calibrated view's
reflectivity, without its neighbours and with them, of kernels and of Hilbert maps
(`kernel_maps.py`), and of the best constant. In the office each cell is something or not.

"BGK" has the values of la3dm's bgkoctomap.yaml (its bgkoctomap_large_map.yaml in 3D). "tuned" is
an upper bound: prior and length are those with the best log loss on the very votes that are
printed, and free points lie a cell apart; Hilbert maps' length and rate are chosen likewise.

The reach of neighbours and the edges of their classes were picked on the first three logs. The
others, and the office, were first looked at when these tables were made.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.kernel_maps import Box, hilbert, kernel_sums, points
from oddsmap import BeamSensor, Scan, build_map, open_log
from oddsmap.kernels.units import ONE
from oddsmap.odds import sigmoid
from oddsmap.simulate import Lidar2D, office_drive, office_plan

LOGS = {
    "intel": ("laser2d/intel-corrected.log.gz", 0.1),
    "freiburg-079": ("laser2d/freiburg-079-corrected.log.gz", 0.1),
    "hall_os0": ("lidar3d/hall_os0", 0.2),
    "aces": ("laser2d/aces-corrected.log.gz", 0.1),
    "belgioioso": ("laser2d/belgioioso-corrected.log.gz", 0.1),
    "orebro": ("laser2d/orebro-corrected.log.gz", 0.1),
    "hku1_avia": ("lidar3d/hku1_avia", 0.2),
}
SHARES, EVERY, SEED, RANGE_MAX = (0.1, 0.02), 10, 1, 50.0
WAYS = ("calibrated", "with neighbours", "BGK", "BGK, tuned", "Hilbert map", "a constant")
# Of la3dm: kernel length, distance of free points by dimension, voxel, prior's hits and passes.
LENGTH, FREE_STEP, LEAF, PRIOR = 0.2, {2: 0.5, 3: 0.2}, 0.1, (0.001, 0.001)
# Tried: lengths in cells, the prior's mean and weight, and the rates of Hilbert maps.
LENGTHS, MEANS, WEIGHTS = (1.5, 2, 3), (0.01, 0.03, 0.1, 0.3, 0.5), (0.01, 0.1, 0.3, 1.0, 3.0)
RATES = (0.5, 0.1)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def some_beams(scan: Scan, share: float, rng: np.random.Generator) -> Scan:
    """A scan with a share of its beams."""
    some = rng.random(len(scan.ranges)) < share
    return Scan(scan.map_from_sensor, scan.directions[some], scan.ranges[some])


def split(data: Path, name: str, share: float) -> tuple[list[Scan], list[Scan]]:
    """Scans of few beams, and those held out."""
    rng, kept, held = np.random.default_rng(SEED), [], []
    for number, scan in enumerate(open_log(data / LOGS[name][0])):
        if number % EVERY == EVERY - 1:
            held.append(scan)
        else:
            kept.append(some_beams(scan, share, rng))
    return kept, held


def log_loss(p: FloatArray, hits: FloatArray, passes: FloatArray) -> float:
    """Of votes [nats]."""
    p = np.clip(p, 1e-9, 1.0 - 1e-9)
    return float(-(hits * np.log(p) + passes * np.log1p(-p)).sum() / (hits + passes).sum())


def scored(p: FloatArray, hits: FloatArray, passes: FloatArray) -> str:
    """Log loss, the area under the ROC curve and calibration error in 20 bins, of votes."""
    _, which = np.unique(p, return_inverse=True)
    hit, passed = np.bincount(which, hits), np.bincount(which, passes)
    below = np.cumsum(passed) - passed / 2.0
    auc = (below * hit).sum() / (hit.sum() * passed.sum())
    votes, place = hits + passes, np.minimum((p * 20).astype(np.int64), 19)
    off = np.abs(np.bincount(place, p * votes) - np.bincount(place, hits)).sum() / votes.sum()
    return f"{log_loss(p, hits, passes):.4f}, {auc:.3f}, {off:.4f}"


def others(
    scans: list[Scan], index: IntArray, side: float, hits: FloatArray, passes: FloatArray
) -> Iterator[FloatArray]:
    """What BGK, BGK tuned and a Hilbert map say of cells; the last two by votes they must tell."""
    lo = index.min(axis=0)
    box = Box(lo, index.max(axis=0) + 1 - lo, side)
    flat, ndim = box.flat(index), index.shape[1]

    def sums(x: FloatArray, y: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
        ones, zeros = kernel_sums(x, y, length, box)
        return ones[flat], zeros[flat]

    ones, zeros = sums(*points(scans, FREE_STEP[ndim], LEAF, RANGE_MAX), LENGTH)
    yield (PRIOR[0] + ones) / (sum(PRIOR) + ones + zeros)
    x, y = points(scans, side, LEAF, RANGE_MAX)
    found = []
    for cells in LENGTHS:
        ones, zeros = sums(x, y, cells * side)
        for mean, weight in itertools.product(MEANS, WEIGHTS):
            p = (mean * weight + ones) / (weight + ones + zeros)
            found.append((log_loss(p, hits, passes), cells, mean, weight, p))
    best = min(found, key=lambda one: one[0])
    sys.stderr.write(f"BGK, tuned: {best[1]} cells; a prior of {best[2]}, weight {best[3]}\n")
    yield best[-1]
    centres = np.asarray((index + 0.5) * side, np.float64)
    maps = [
        np.asarray(sigmoid(hilbert(x, y, centres, cells * side, rate=rate)))
        for cells, rate in itertools.product(LENGTHS[1:], RATES)
    ]
    yield min(maps, key=lambda p: log_loss(p, hits, passes))


def rows(
    name: str, ours: list[FloatArray], kept: list[Scan], known: npt.NDArray[np.bool_],
    index: IntArray, side: float, hits: FloatArray, passes: FloatArray,
) -> None:  # fmt: skip
    """Print two rows: of cells that are known, and of those that are not."""
    ways = [*ours, *others(kept, index, side, hits, passes)]
    for chosen, cells in ((known, "known"), (~known, "unseen")):
        h, p = hits[chosen], passes[chosen]
        row = [scored(way[chosen], h, p) for way in ways]
        row.append(f"{log_loss(np.full(len(h), h.sum() / (h + p).sum()), h, p):.4f}")
        votes = f"{(h + p).sum():,.0f}"
        sys.stdout.write(f"| {name} | {cells} | {votes} | {' | '.join(row)} |\n")
        sys.stdout.flush()


def of_log(data: Path, name: str, share: float) -> None:
    """Two rows of a log."""
    kept, held = split(data, name, share)
    side, sensor = LOGS[name][1], BeamSensor(range_max=RANGE_MAX)
    grid, other = (build_map(part, side, sensor=sensor) for part in (kept, held))
    index, *units = other.cells()
    hits, passes = (np.asarray(x) / ONE for x in units)
    ours = []
    for neighbours in (False, True):
        view = grid.calibrated(neighbours=neighbours).reflectivity
        alpha, beta, known = view.parameters_at(index)
        ours.append(alpha / (alpha + beta))
    rows(f"{name}, {share:.0%}", ours, kept, known, index, side, hits, passes)


def of_office(share: float) -> None:
    """Two rows of the office: cells with evidence, and those within four cells of some."""
    rng, plan, lidar, side = np.random.default_rng(SEED), office_plan(), Lidar2D(), 0.1
    scans = [lidar.scan(plan, pose, rng) for pose in office_drive(320)]
    kept = [some_beams(scan, share, rng) for scan in scans]
    grid = build_map(kept, side, sensor=BeamSensor(range_max=lidar.range_max))
    box = np.zeros(2, np.int64), np.array([200, 140])
    truth = plan.rasterise(side, (0, 0), (200, 140), samples=5)
    seen = grid.log_odds().observed(box)
    near = np.zeros_like(seen)
    for y, x in np.argwhere(seen):
        near[max(y - 4, 0) : y + 5, max(x - 4, 0) : x + 5] = True
    y, x = np.nonzero(near)
    ours = [grid.calibrated(neighbours=n).probability(box)[y, x] for n in (False, True)]
    there = truth[y, x].astype(np.float64)
    index = np.stack([x, y], axis=1)
    rows(f"office, {share:.0%}", ours, kept, seen[y, x], index, side, there, 1.0 - there)


def main() -> None:
    """Print a table, in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="with laser2d/ and lidar3d/")
    parser.add_argument("--log", action="append", choices=LOGS, help="only this log; repeatable")
    parser.add_argument("--share", action="append", type=float, help="of beams; repeatable")
    parser.add_argument("--quick", action="store_true", help="the first log alone, 2 %% of it")
    parser.add_argument("--truth", action="store_true", help="the office")
    options = parser.parse_args()
    if options.truth == (options.data is not None):
        parser.error("give --data DIR for real logs, or --truth for the office")
    warnings.simplefilter("ignore")
    what = "cells" if options.truth else "votes"
    sys.stdout.write(f"| log loss, AUC, ECE | | {what} | {' | '.join(WAYS)} |\n")
    sys.stdout.write("|---" * (3 + len(WAYS)) + "|\n")
    names = (options.log or list(LOGS))[: 1 if options.quick else None] if options.data else []
    shares = options.share or (SHARES[-1:] if options.quick else SHARES)
    for name, share in itertools.product(names, shares):
        of_log(options.data, name, share)
    for share in shares if options.truth else ():
        of_office(share)


if __name__ == "__main__":
    main()
