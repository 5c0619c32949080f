# SPDX-License-Identifier: Apache-2.0
"""Maps of the simulated sonar benchmark against its truth, estimator by estimator.

Part of `full_map.py`, which prints the table. Estimators get the rates that a file states; the
specular case E6 gets the model of the design, since no file says how specular its walls are.

The files' mask `scored` is made with the truth: it keeps cells up to the true range. Whoever uses a
map has the map's own mask alone, so full maps are scored once more on the cells that they
themselves call observed.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.peers.thrun_em import thrun_em
from oddsmap import Scan, build_map, evaluate, open_log
from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.forward.beam_rows import list_rows
from oddsmap.forward.cell_grid import CellField
from oddsmap.full_map.estimator import build_full_map
from oddsmap.full_map.full_map import FullMap
from oddsmap.full_map.online import OnlineFullMap
from oddsmap.kernels.infer.beam_factor import NAT, BeamRows
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.registry import stated_of_sensor
from oddsmap.sensors.usable_beams import usable_beams

__all__ = ["CASES", "Case", "load_cases", "score_all"]

FloatArray = npt.NDArray[np.float64]
# Probabilities, and the cells that the estimator calls observed, where it says.
Estimate = tuple[FloatArray, npt.NDArray[np.bool_] | None]
Estimates = dict[str, Callable[["Case", list["Case"]], Estimate]]

CASES = ("E1", "E2", "E3", "E4", "E5", "E6", "E7")
RESOLUTION = 0.1
_SPECULAR = {"detection": 0.3, "p_dropout": 0.3, "p_random": 0.1, "sigma": 0.04}
# Shapes of the inverse cone model that are tried: which share of the hit, arc depth, falloff.
_SHAPES = tuple(product((True, False), (0.0, 0.2), (0.0, 0.9)))


@dataclass(frozen=True, eq=False)
class Case:
    """One file of the benchmark.

    Args:
        name: E1 to E7.
        scans: with poses.
        sensor: what the file says of it.
        truth: True where a cell is occupied, shape (ny, nx).
        scored: True for the cells to score, same shape.
    """

    name: str
    scans: list[Scan]
    sensor: dict[str, Any]
    truth: npt.NDArray[np.bool_]
    scored: npt.NDArray[np.bool_]

    @property
    def region(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """The grid's box of cells."""
        ny, nx = self.truth.shape
        return (0, 0), (nx, ny)

    def of(self, view: FullMap) -> Estimate:
        """A full map's probabilities, and which cells it calls observed."""
        return view.probability(self.region), view.observed(self.region)

    @cached_property
    def counts(self) -> list[FloatArray]:
        """Hits and passes of each scored cell, shape (n, 2), for each shape of inverse model."""
        found = []
        for share, width, falloff in _SHAPES:
            plain = {k: v for k, v in self.sensor.items() if k in ("cone_deg", "range_max")}
            sensor = ConeSensor(**plain, share_hit=share, hit_width=width, angular_falloff=falloff)
            dense = np.zeros((*self.truth.shape, 2))
            index, hits, passes = build_map(self.scans, RESOLUTION, sensor=sensor).cells()
            inside = ((index >= 0) & (index < self.truth.shape[::-1])).all(axis=1)
            x, y = index[inside].T
            dense[y, x, 0], dense[y, x, 1] = hits[inside] / 65536, passes[inside] / 65536
            found.append(dense[self.scored])
        return found


def load_cases(folder: Path, name: str) -> list[Case]:
    """The files of one case, seed by seed."""
    cases = []
    for path in sorted(folder.glob(f"{name}_*.npz")):
        log, arrays = open_log(path), np.load(path)
        said = stated_of_sensor(log)
        said.pop("kind")
        said |= _SPECULAR if name == "E6" else {}
        cases.append(Case(name, list(log), said, arrays["truth"], arrays["scored"]))
    return cases


def score_all(
    folder: Path, names: Sequence[str], quick: bool, *, full_maps_alone: bool = False
) -> dict[str, dict[str, str]]:
    """Case -> estimator -> "log loss / ECE / IoU", mean over the seeds.

    Those of estimators that say which cells they have observed come a second time, on these, with
    the CPU time that a map took, from scans to probabilities, on one thread.
    """
    estimators = _FULL_MAPS if full_maps_alone else _FULL_MAPS | _OTHERS
    table: dict[str, dict[str, str]] = {}
    for name in names:
        cases = load_cases(folder, name)
        if not table:
            # Kernels are loaded or compiled before any time is taken.
            few = [dataclasses.replace(case, scans=case.scans[:3]) for case in cases[:2]]
            for estimate in estimators.values():
                estimate(few[0], few)
        table[name] = {}
        for title, estimate in estimators.items():
            slow = title == "Thrun's EM"
            chosen = cases[:1] if slow or quick else cases
            seeds = f" ({len(chosen)} of {len(cases)} seeds)" if len(chosen) < len(cases) else ""
            started = time.process_time()
            made = [(*estimate(case, cases), case) for case in chosen]
            taken = (time.process_time() - started) / len(made)
            table[name][title] = (
                _mean([(p, case.truth, case.scored) for p, _, case in made]) + seeds
            )
            own = [(p, case.truth, seen) for p, seen, case in made if seen is not None]
            if own:
                observed = f"{_mean(own)}, {taken:.1f} s of CPU"
                table[name][f"{title}, on what it calls observed"] = observed + seeds
        print(f"{name}: {table[name]}", file=sys.stderr, flush=True)
    return table


def _mean(made: list[tuple[FloatArray, npt.NDArray[np.bool_], npt.NDArray[np.bool_]]]) -> str:
    scores = [evaluate(p, truth, mask) for p, truth, mask in made]
    mean = np.mean([(s.log_loss, s.ece, s.iou) for s in scores], axis=0)
    return "{:.4f} / {:.4f} / {:.3f}".format(*mean)


def _full_map(case: Case, _: list[Case]) -> Estimate:
    sensor = ConeSensor(**case.sensor)
    return case.of(build_full_map(case.scans, RESOLUTION, sensor=sensor))


def _online(case: Case, _: list[Case]) -> Estimate:
    config = Config(map=MapConfig(resolution=RESOLUTION), sensor=ConeSensor(**case.sensor))
    estimator = OnlineFullMap(config)
    estimator.add_scans(case.scans)
    return case.of(estimator.view())


def _gibbs(case: Case, _: list[Case]) -> Estimate:
    settings = FullMapConfig(method="gibbs", samples=100, burn_in=20)
    sensor = ConeSensor(**case.sensor)
    view = build_full_map(case.scans, RESOLUTION, sensor=sensor, settings=settings)
    return case.of(view)


def _windows(case: Case, _: list[Case]) -> Estimate:
    settings = FullMapConfig(method="gibbs", prior_model="windows")
    sensor = ConeSensor(**case.sensor)
    view = build_full_map(case.scans, RESOLUTION, sensor=sensor, settings=settings)
    return case.of(view)


def _thrun(case: Case, _: list[Case]) -> Estimate:
    sensor = ConeSensor(**case.sensor)
    model = sensor.forward_model()
    field, rows = _rows(case)
    found = thrun_em(
        rows,
        len(field.belief),
        bin_width=model.bin_width_at(RESOLUTION),
        range_max=model.range_max,
        p_rand=model.p_random,
        p_hit=min(0.9, model.detection),
        prior=0.2,
    )
    place = _places(field.index(np.arange(len(field.belief))), case.truth.shape)
    return _dense(found.probability, place, case.truth.shape, 0.2), None


def _textbook(case: Case, _: list[Case]) -> Estimate:
    # Probabilistic Robotics, table 9.2, with its log odds of .85 and -.4.
    plain = {k: v for k, v in case.sensor.items() if k in ("cone_deg", "range_max")}
    p_hit, p_miss = (1.0 / (1.0 + math.exp(-l)) for l in (0.85, -0.4))  # noqa: E741
    sensor = ConeSensor(**plain, share_hit=False, p_hit=p_hit, p_miss=p_miss)
    view = build_map(case.scans, RESOLUTION, sensor=sensor).log_odds()
    return view.probability(case.region), None


def _tuned(case: Case, cases: list[Case]) -> Estimate:
    # Log odds = offset + a hits - b passes: what any p_hit, p_miss and Platt scale can do, fitted
    # with the truth of the other seeds, and so the shape of the cone.
    others = [other for other in cases if other is not case]
    truth = np.concatenate([other.truth[other.scored] for other in others])
    best, chosen, weights = math.inf, 0, np.zeros(3)
    for shape in range(len(_SHAPES)):
        x = _design(np.concatenate([other.counts[shape] for other in others]))
        fitted, loss = _logistic(x, truth)
        if loss < best:
            best, chosen, weights = loss, shape, fitted
    probability = np.full(case.truth.shape, 0.5)
    probability[case.scored] = _sigmoid(_design(case.counts[chosen]) @ weights)
    return probability, None


_FULL_MAPS: Estimates = {
    "full map": _full_map,
    "online": _online,
    "Gibbs, 100 sweeps": _gibbs,
    "Gibbs, windows": _windows,
}
_OTHERS: Estimates = {
    "Thrun's EM": _thrun,
    "inverse model, tuned and scaled": _tuned,
    "inverse model, textbook": _textbook,
}


def _rows(case: Case) -> tuple[CellField, BeamRows]:
    sensor = ConeSensor(**case.sensor)
    prior = Config(map=MapConfig(resolution=RESOLUTION), sensor=sensor).full_map.prior_in(2)
    field = CellField(2, round(math.log(prior / (1.0 - prior)) * NAT))
    beams, _, _ = usable_beams(case.scans, sensor)
    return field, list_rows(field, beams, sensor.forward_model(), RESOLUTION)


def _places(index: npt.NDArray[np.int64], shape: tuple[int, ...]) -> npt.NDArray[np.int64]:
    # Of cells in the flat grid, -1 outside.
    ny, nx = shape
    x, y = index.T
    inside = (x >= 0) & (x < nx) & (y >= 0) & (y < ny)
    return np.where(inside, y * nx + x, -1)


def _dense(
    values: FloatArray, place: npt.NDArray[np.int64], shape: tuple[int, ...], fill: float
) -> FloatArray:
    grid = np.full(math.prod(shape), fill)
    grid[place[place >= 0]] = values[place >= 0]
    return grid.reshape(shape)


def _design(counts: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(counts)), counts])


def _sigmoid(x: FloatArray) -> FloatArray:
    return 1.0 / (1.0 + np.exp(-np.clip(x, -50.0, 50.0)))


def _logistic(x: FloatArray, truth: npt.NDArray[np.bool_]) -> tuple[FloatArray, float]:
    """Weights of a logistic regression by Newton's method, and its log loss."""
    weights = np.zeros(x.shape[1])
    for p in _newton(x, truth, weights):
        loss = -np.log(np.clip(np.where(truth, p, 1.0 - p), 1e-12, None)).mean()
    return weights, float(loss)


def _newton(
    x: FloatArray, truth: npt.NDArray[np.bool_], weights: FloatArray
) -> Iterator[FloatArray]:
    for _ in range(30):
        p = _sigmoid(x @ weights)
        # A ridge of 1e-6 keeps the step finite where a count never varies.
        curvature = (x * (p * (1.0 - p))[:, None]).T @ x + 1e-6 * np.eye(x.shape[1])
        weights += np.linalg.solve(curvature, x.T @ (truth - p))
        yield _sigmoid(x @ weights)
