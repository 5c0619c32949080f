# SPDX-License-Identifier: Apache-2.0
"""Do the counts around a cell help where beams are few? Held-out beams of real logs say.

    python benchmarks/neighbours.py --data ../shared/data      # 9 s of CPU

Every tenth scan is held out; of the others 10 % or 2 % of the beams make the map, chosen at random.
Each vote of a held-out scan is a hit or a pass, in a cell that the map knows or in one that it has
not seen. Printed of both: votes, and log loss [nats] and AUC of the calibrated view's reflectivity,
without its neighbours and with them, and of the best constant.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from oddsmap import BeamSensor, EvidenceMap, Scan, build_map, open_log
from oddsmap.kernels.units import ONE

LOGS = {
    "intel": ("laser2d/intel-corrected.log.gz", 0.1, 50.0),
    "freiburg-079": ("laser2d/freiburg-079-corrected.log.gz", 0.1, 50.0),
    "hall_os0": ("lidar3d/hall_os0", 0.2, 50.0),
}
SHARES, EVERY, SEED = (0.1, 0.02), 10, 1

FloatArray = npt.NDArray[np.float64]


def maps(data: Path, name: str, share: float) -> tuple[EvidenceMap, EvidenceMap]:
    """The map of some beams, and that of the scans held out."""
    path, resolution, range_max = LOGS[name]
    rng, kept, held = np.random.default_rng(SEED), [], []
    for number, scan in enumerate(open_log(data / path)):
        if number % EVERY == EVERY - 1:
            held.append(scan)
            continue
        some = rng.random(len(scan.ranges)) < share
        kept.append(Scan(scan.map_from_sensor, scan.directions[some], scan.ranges[some]))
    sensor = BeamSensor(range_max=range_max)
    first, second = (build_map(part, resolution, sensor=sensor) for part in (kept, held))
    return first, second


def scored(p: FloatArray, hits: FloatArray, passes: FloatArray) -> str:
    """Log loss and the area under the ROC curve, of votes."""
    p = np.clip(p, 1e-9, 1.0 - 1e-9)
    loss = -(hits * np.log(p) + passes * np.log1p(-p)).sum() / (hits + passes).sum()
    _, which = np.unique(p, return_inverse=True)
    hit, passed = np.bincount(which, hits), np.bincount(which, passes)
    below = np.cumsum(passed) - passed / 2.0
    return f"{loss:.4f}, {(below * hit).sum() / (hit.sum() * passed.sum()):.3f}"


def main() -> None:
    """Print the table, in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="with laser2d/ and lidar3d/")
    parser.add_argument("--quick", action="store_true", help="the first log alone")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    write = sys.stdout.write
    write("| log loss, AUC | cells | votes | calibrated | with neighbours | a constant |\n")
    write("|---|---|---|---|---|---|\n")
    for name in list(LOGS)[: 1 if options.quick else None]:
        for share in SHARES:
            grid, other = maps(options.data, name, share)
            index, *units = other.cells()
            hits, passes = (np.asarray(x) / ONE for x in units)
            of = []
            for neighbours in (False, True):
                view = grid.calibrated(neighbours=neighbours).reflectivity
                alpha, beta, known = view.parameters_at(index)
                of.append(alpha / (alpha + beta))
            of.append(np.zeros(len(index)))
            for chosen, cells in ((known, "known"), (~known, "unseen")):
                h, p = hits[chosen], passes[chosen]
                of[2][chosen] = h.sum() / (h + p).sum()
                row = " | ".join(scored(way[chosen], h, p) for way in of)
                votes = f"{(h + p).sum():,.0f}"
                write(f"| {name}, {share:.0%} of the beams | {cells} | {votes} | {row} |\n")


if __name__ == "__main__":
    main()
