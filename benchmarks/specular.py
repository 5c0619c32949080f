# SPDX-License-Identifier: Apache-2.0
"""Does a detection probability that depends on direction help against specular misses?

    python benchmarks/specular.py --data ../shared/data/sonar_bench

Case E6 of the sonar benchmark: surfaces echo within 35 degrees of their normal only, so that
neighbouring beams miss together. Two ways to tell the forward model so, both in rounds: the map is
estimated, detection is renewed from it, the map is estimated again.

- incidence: detection of a cell for a beam by the angle between the beam and the gradient of the
  smoothed belief, from `HIGH` head on to `LOW` beyond the angle; where the belief is flat, the
  model's.
- octant: a detection probability for each cell and octant of directions, by fractional-count EM
  with a Beta prior around the model's.

The log loss, calibration error and IoU after each round are printed, the first without either.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import oddsmap
from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.forward.beam_rows import list_rows
from oddsmap.forward.cell_grid import CellField
from oddsmap.full_map.belief_propagation import Propagation
from oddsmap.kernels.infer.beam_factor import NAT, BeamRows, beam_room, chances, factor
from oddsmap.kernels.infer.first_echo import Noise
from oddsmap.kernels.jit import kernel
from oddsmap.scoring.truth import evaluate
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.usable_beams import usable_beams

FloatArray = npt.NDArray[np.float64]

RESOLUTION = 0.1
MODEL = {"detection": 0.3, "p_dropout": 0.3, "p_random": 0.1, "sigma": 0.04}
ROUNDS = 3
HIGH, LOW, ANGLE, SOFT, SMOOTH, STEEP = 0.9, 0.1, 35.0, 8.0, 2.0, 0.05
OCTANTS, WEIGHT = 8, 20.0


@kernel
def count_trials(
    rows: BeamRows, noise: Noise, one: FloatArray, occupied: FloatArray,
    hit: FloatArray, miss: FloatArray,
) -> None:  # fmt: skip
    """For each row the probability that its cell echoed, and that it was reached and silent."""
    u, d, sums, starts = beam_room(rows)
    for beam in range(rows.readings.shape[0]):
        begin, end = rows.offsets[beam], rows.offsets[beam + 1]
        for i in range(begin, end):
            u[i - begin] = occupied[i]
        chances(rows, begin, end, one, u, d)
        groups = factor(rows, beam, noise, u, sums, starts)
        total = 1.0
        for g in range(groups):
            silent, here, through, _, behind = sums[:, g]
            if g == 0:
                total = (1.0 - silent) * here + silent * behind
            for j in range(starts[g], starts[g + 1]):
                others = silent / u[j]
                rest = (1.0 - others) * here + others * behind
                share = through * occupied[begin + j] / total
                hit[begin + j] = share * d[j] * here
                miss[begin + j] = share * (1.0 - d[j]) * rest


class Case:
    """One log, with its first estimate under the plain model."""

    def __init__(self, path: Path) -> None:
        log = oddsmap.open_log(path)
        said: dict[str, Any] = {**log.sensor, **MODEL}
        sensor = ConeSensor(**said)
        self.model = sensor.forward_model()
        beams, _, _ = usable_beams(list(log), sensor)
        self.field = CellField(2, round(-0.1 * NAT))
        self.rows = list_rows(self.field, beams, self.model, RESOLUTION)
        self.config = Config(
            map=MapConfig(resolution=RESOLUTION), sensor=sensor, full_map=FullMapConfig(sweeps=8)
        )
        with np.load(path) as file:
            self.truth, self.scored = file["truth"], file["scored"]
        beam = np.repeat(np.arange(len(beams)), np.diff(self.rows.offsets))
        self.index = self.field.index(self.rows.cells)
        self.way = (self.index + 0.5) * RESOLUTION - beams.origins[beam]
        self.messages = np.zeros(len(self.rows.cells), np.int32)
        self.estimate(np.full(len(beam), MODEL["detection"]))

    def estimate(self, detection: FloatArray) -> None:
        """Go on with propagation, given the detection probability of each row's cell."""
        self.given = self.rows._replace(
            fractions=(self.rows.fractions * detection).astype(np.float32)
        )
        work = Propagation(
            self.field, self.given, self.model.noise(RESOLUTION), np.ones(1), self.config.full_map
        )
        work.messages = self.messages
        work.run()

    def picture(self, lo: npt.NDArray[np.int64], hi: npt.NDArray[np.int64]) -> FloatArray:
        """Probabilities of a box of cells."""
        image = np.full((hi - lo)[::-1], 0.5)
        index = self.field.index(np.arange(len(self.field.belief)))
        inside = ((index >= lo) & (index < hi)).all(axis=1)
        x, y = (index[inside] - lo).T
        image[y, x] = 1.0 / (1.0 + np.exp(-self.field.belief[inside] / NAT))
        return image

    def scores(self) -> list[float]:
        """Log loss, calibration error, IoU."""
        size = np.array(self.truth.shape[::-1])
        got = evaluate(self.picture(np.zeros(2, np.int64), size), self.truth, self.scored)
        return [got.log_loss, got.ece, got.iou]


def by_incidence(case: Case) -> FloatArray:
    """Detection of each row's cell by the angle to the belief's gradient."""
    from scipy.ndimage import gaussian_filter

    lo, hi = case.index.min(axis=0) - 5, case.index.max(axis=0) + 6
    rise_y, rise_x = np.gradient(gaussian_filter(case.picture(lo, hi), SMOOTH))
    x, y = (case.index - lo).T
    normal = np.stack([rise_x[y, x], rise_y[y, x]], axis=1)
    steep = np.linalg.norm(normal, axis=1)
    product = np.abs((normal * case.way).sum(axis=1))
    cosine = product / np.maximum(steep * np.linalg.norm(case.way, axis=1), 1e-12)
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    seen = LOW + (HIGH - LOW) / (1.0 + np.exp((angle - ANGLE) / SOFT))
    sure = np.clip(steep / STEEP, 0.0, 1.0)
    return np.asarray(sure * seen + (1.0 - sure) * MODEL["detection"])


def by_octant(case: Case) -> FloatArray:
    """Detection of each row's cell from the counts of its octant."""
    occupied = 1.0 / (1.0 + np.exp(-case.field.belief[case.rows.cells] / NAT))
    hit, miss = np.zeros(len(occupied)), np.zeros(len(occupied))
    noise = case.model.noise(RESOLUTION)
    count_trials(case.given, noise, np.ones(1), occupied, hit, miss)
    turn = np.arctan2(case.way[:, 1], case.way[:, 0]) / (2.0 * np.pi)
    octant = np.floor(turn * OCTANTS).astype(np.int64) % OCTANTS
    key = case.rows.cells.astype(np.int64) * OCTANTS + octant
    size = len(case.field.belief) * OCTANTS
    hits, misses = np.bincount(key, hit, size), np.bincount(key, miss, size)
    mean = (WEIGHT * MODEL["detection"] + hits) / (WEIGHT + hits + misses)
    return np.asarray(np.minimum(mean, 0.98)[key])


def main() -> None:
    """Score both ways on all seeds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="the sonar_bench folder")
    paths = sorted(parser.parse_args().data.glob("E6*.npz"))
    if not paths:
        parser.error("no E6*.npz in that folder")
    for renew in (by_incidence, by_octant):
        rounds = []
        for path in paths:
            case = Case(path)
            scores = [case.scores()]
            for _ in range(ROUNDS):
                case.estimate(renew(case))
                scores.append(case.scores())
            rounds.append(scores)
        for number, row in enumerate(np.mean(rounds, axis=0)):
            print(
                f"{renew.__name__:13} round {number}: log loss {row[0]:.4f}  "
                f"ECE {row[1]:.4f}  IoU {row[2]:.3f}"
            )


if __name__ == "__main__":
    main()
