# SPDX-License-Identifier: Apache-2.0
"""Learn the window prior of full maps, and choose its strength.

    python benchmarks/window_prior.py                # the table of full_map/window_prior.py
    python benchmarks/window_prior.py --strength     # how strong: log loss on other worlds

A prior over maps, p(m) proportional to exp(sum of potentials of all 3 x 3 windows), is fitted by
maximum pseudo-likelihood (Besag 1975): each cell is predicted from the 24 around it. That is a
logistic regression whose features count the windows of each kind that an occupied cell would make,
less those that a free one would; it is convex, and Newton's method ends at the same table each
time. Windows that a turn or a mirror takes into each other share a potential: 102 kinds.

Learnt from worlds of `window_worlds.py`, seeds 0 to 29 of each family, every cell but those of the
outer wall. The strength is chosen on seeds 1000 and 1001, seen by simulated sonars: neither has to
do with the worlds of sonar_bench. Real maps are not used: behind a wall that a lidar has seen
everything is unknown, and a window needs all of its cells.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.window_worlds import CELL, FAMILIES, FINE, cells_of, drive, world
from oddsmap import ConeSensor, FullMapConfig, build_full_map, evaluate
from oddsmap.full_map import window_prior
from oddsmap.full_map.window_prior import kinds_of_windows, lines_of
from oddsmap.simulate import Sonar2D

__all__ = ["learn", "training_maps"]

FloatArray = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

SEEDS, TRIED = range(30), (1000, 1001)
STRENGTHS = (0.5, 0.65, 0.8, 1.0)
# Scans and the cone [deg] of the worlds that are tried, in turn.
SENSORS = ((400, 25.0), (400, 30.0), (100, 25.0))
# Of the mean log loss of a cell: a kind that hardly occurs stays near 0. Of 1e-4 and 1e-5 the
# second is better on the worlds of `--strength`, .0676 against .0698.
_RIDGE = 1e-5
# The outer wall, behind which there is nothing, and half a window more.
_EDGE = 4


def learn(maps: Iterable[Bools], ridge: float = _RIDGE) -> FloatArray:
    """Potentials of the kinds of windows from whole maps, True where occupied, shape (kinds,)."""
    around, counts = _neighbourhoods(maps)
    kind = kinds_of_windows()
    features = np.zeros((len(around), kind.max() + 1))
    row = np.arange(len(around))
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            window, centre = _window(around, dy, dx)
            np.add.at(features, (row, kind[window | centre]), 1.0)
            np.add.at(features, (row, kind[window & ~centre]), -1.0)
    return _regression(features, counts, ridge)


def _neighbourhoods(maps: Iterable[Bools]) -> tuple[npt.NDArray[np.int64], FloatArray]:
    # The 5 x 5 cells around each, centre left out, as bits, each pattern once; how often the
    # centre is free and occupied, shape (n, 2).
    found = []
    for occupied in maps:
        m = occupied.astype(np.int64)
        ny, nx = m.shape
        code = np.zeros((ny - 4, nx - 4), np.int64)
        for y in range(5):
            for x in range(5):
                code |= m[y : ny - 4 + y, x : nx - 4 + x] << (5 * y + x)
        found.append(code.ravel())
    centre = 1 << 12
    codes, times = np.unique(np.concatenate(found), return_counts=True)
    around, at = np.unique(codes & ~centre, return_inverse=True)
    counts = np.zeros((len(around), 2))
    np.add.at(counts, (at, (codes & centre) // centre), times)
    return around, counts


def _window(around: npt.NDArray[np.int64], dy: int, dx: int) -> tuple[npt.NDArray[np.int64], int]:
    # The window whose middle lies (dx, dy) from the cell, as bits, and the cell's bit in it.
    window = np.zeros(len(around), np.int64)
    for y in range(3):
        for x in range(3):
            bit = 5 * (y + dy + 1) + (x + dx + 1)
            window |= ((around >> bit) & 1) << (3 * y + x)
    return window, 1 << (3 * (1 - dy) + (1 - dx))


def _regression(features: FloatArray, counts: FloatArray, ridge: float) -> FloatArray:
    # Newton's method; of the ridge's weight the mean log loss and not the sum is told.
    times = counts.sum(axis=1) / counts.sum()
    occupied = counts[:, 1] / counts.sum()
    potentials = np.zeros(features.shape[1])
    for _ in range(100):
        p = 1.0 / (1.0 + np.exp(-(features @ potentials)))
        slope = features.T @ (occupied - times * p) - 2.0 * ridge * potentials
        curvature = (features * (times * p * (1.0 - p))[:, None]).T @ features
        step = np.linalg.solve(curvature + 2.0 * ridge * np.eye(len(slope)), slope)
        potentials += step
        if np.abs(step).max() < 1e-9:
            break
    return potentials


def training_maps() -> Iterable[Bools]:
    """The worlds that the shipped table is learnt from, without their outer walls."""
    for family in FAMILIES:
        for seed in SEEDS:
            yield cells_of(world(family, seed))[_EDGE:-_EDGE, _EDGE:-_EDGE]


def _try_strengths() -> None:
    print("| world | sum-product | " + " | ".join(f"{s:g}" for s in STRENGTHS) + " |")
    print("|---" * (len(STRENGTHS) + 2) + "|")
    found = []
    for number, (family, seed) in enumerate(itertools.product(FAMILIES, TRIED)):
        scan_count, cone_deg = SENSORS[number % len(SENSORS)]
        losses = _losses(world(family, seed), scan_count, cone_deg, seed)
        found.append(losses)
        told = f"{family} {seed}, {scan_count} scans of {cone_deg:g} degrees"
        print(f"| {told} | " + " | ".join(f"{x:.4f}" for x in losses) + " |", flush=True)
    print("| mean | " + " | ".join(f"{x:.4f}" for x in np.mean(found, axis=0)) + " |")


def _losses(fine: Bools, scan_count: int, cone_deg: float, seed: int) -> list[float]:
    # Log loss on observed cells: of sum-product, and of the window prior by strength.
    rates: dict[str, Any] = {"cone_deg": cone_deg, "p_random": 0.03, "p_dropout": 0.03}
    scans = drive(fine, Sonar2D(**rates), scan_count, np.random.default_rng(seed), FINE)
    truth = cells_of(fine)
    box = (0, 0), truth.shape[::-1]
    losses = []
    for strength in (None, *STRENGTHS):
        settings = FullMapConfig()
        if strength is not None:
            settings = FullMapConfig(method="gibbs", prior_model="windows")
            window_prior.STRENGTH = strength
        full_map = build_full_map(
            scans, CELL, sensor=ConeSensor(range_max=4.0, **rates), settings=settings
        )
        p, observed = full_map.probability(box), full_map.observed(box)
        losses.append(evaluate(p, truth, observed).log_loss)
    return losses


def main() -> None:
    """Print the table, or what each strength gives."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--strength", action="store_true", help="try strengths on other worlds")
    if parser.parse_args().strength:
        _try_strengths()
        return
    print("\n".join(lines_of(learn(training_maps()))))


if __name__ == "__main__":
    main()
