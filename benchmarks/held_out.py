# SPDX-License-Identifier: Apache-2.0
"""What a held-out score says, and what full maps promise by it.

    python benchmarks/held_out.py --bench ../shared/data/sonar_bench
    python benchmarks/held_out.py udacity.npz --set detection=0.3

With --bench the held-out beams of E1 are scored under the true map and under the full map, mean
over the seeds. With logs of cones (examples/udacity.py and tof8x8.py make some) the full map and
the textbook's filter are scored under the same forward model, on every fifth scan held out and on
every fifth of 25 blocks of scans. All figures are nats per beam.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import oddsmap
from benchmarks.sonar_accuracy import RESOLUTION, load_cases
from oddsmap.full_map.full_map import FullMap
from oddsmap.kernels.infer.cell_status import REACHED
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.registry import sensor_of_log

FOLDS, BLOCKS = 5, 25
# Log odds .85 and -.4 of Probabilistic Robotics, table 9.2.
_P_HIT, _P_MISS = (1.0 / (1.0 + math.exp(-odds)) for odds in (0.85, -0.4))
# Log odds of a true map's cells.
_SURE = 7.0


def on_truth(folder: Path) -> None:
    """The true map of E1 and the full map, by the files' held-out beams."""
    found = []
    for case, path in zip(load_cases(folder, "E1"), sorted(folder.glob("E1_*.npz")), strict=True):
        sensor = ConeSensor(**case.sensor)
        with np.load(path) as arrays:
            beams = arrays["heldout_beams"].astype(float)
        way = np.array([[1.0, 0.0]])
        far = sensor.range_max
        held = [
            oddsmap.Scan(oddsmap.Pose2(x, y, a), way, np.array([z if z < far else np.inf]))
            for x, y, a, z in beams.tolist()
        ]
        full = oddsmap.build_full_map(case.scans, RESOLUTION, sensor=sensor)
        true = as_full_map(case.truth, full)
        found.append([oddsmap.score_map(m, held, sensor).log_likelihood for m in (true, full)])
    true_score, full_score = np.mean(found, axis=0)
    print(f"E1, {len(found)} seeds: the true map {true_score:.3f}, the full map {full_score:.3f}")


def as_full_map(truth: npt.NDArray[np.bool_], like: FullMap) -> FullMap:
    """The true map, all of it observed, in the blocks of a full map."""
    side = math.isqrt(like.values.shape[1])
    high, wide = (-(-n // side) for n in truth.shape)
    grid = np.zeros((2, high * side, wide * side))
    grid[0, : truth.shape[0], : truth.shape[1]] = np.where(truth, _SURE, -_SURE)
    grid[1, : truth.shape[0], : truth.shape[1]] = REACHED
    odds, marks = (
        g.reshape(high, side, wide, side).swapaxes(1, 2).reshape(-1, side * side) for g in grid
    )
    y, x = np.indices((high, wide)).reshape(2, -1)
    return FullMap(
        like.config, np.stack([x, y], axis=1), odds.astype(np.float32), marks.astype(np.uint8),
        sweeps=1, residual=0.0,
    )  # fmt: skip


def on_log(path: Path, changes: dict[str, float]) -> None:
    """The full map and the filter of a log, by the scans that were held out."""
    log = oddsmap.open_log(path)
    stated = sensor_of_log(log)
    if not isinstance(stated, ConeSensor):
        raise SystemExit(f"{path}: cones are needed, got a sensor of kind {stated.kind}")
    # Changes have fields of several types, which `replace` cannot check by their names.
    sensor = dataclasses.replace(stated, **changes)  # type: ignore[arg-type]
    textbook = dataclasses.replace(sensor, share_hit=False, p_hit=_P_HIT, p_miss=_P_MISS)
    scans = list(log)
    number = np.arange(len(scans))
    for title, part in (("scans", number), ("blocks", number * BLOCKS // len(scans))):
        out = part % FOLDS == FOLDS - 1
        kept, held = pick(scans, ~out), pick(scans, out)
        full = oddsmap.build_full_map(kept, RESOLUTION, sensor=sensor)
        plain = oddsmap.build_map(kept, RESOLUTION, sensor=textbook).log_odds()
        ours, theirs = (oddsmap.score_map(m, held, sensor).log_likelihood for m in (full, plain))
        print(
            f"{path.name}, {title} held out: full map {ours:.3f}, textbook {theirs:.3f}, "
            f"gain {ours - theirs:.3f}",
            flush=True,
        )


def pick(scans: Sequence[oddsmap.Scan], chosen: npt.NDArray[np.bool_]) -> list[oddsmap.Scan]:
    """The scans that are chosen."""
    return [scan for scan, taken in zip(scans, chosen, strict=True) if taken]


def main() -> None:
    """Score what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("logs", type=Path, nargs="*")
    parser.add_argument("--bench", type=Path, help="the sonar_bench folder")
    parser.add_argument("--set", action="append", default=[], help="NAME=VALUE of the sensor")
    options = parser.parse_args()
    if options.bench is not None:
        on_truth(options.bench)
    changes = {name: float(value) for name, value in (s.split("=") for s in options.set)}
    for path in options.logs:
        on_log(path, changes)


if __name__ == "__main__":
    main()
