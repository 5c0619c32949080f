# SPDX-License-Identifier: Apache-2.0
"""Sum-product, hill climbing and Gibbs sampling on the simulated sonar benchmark.

    python benchmarks/full_map_methods.py --data DIR             # about eight minutes
    python benchmarks/full_map_methods.py --data DIR --quick     # one seed of each case

DIR holds sonar_bench/. Prints log loss, calibration error and IoU over `scored` cells, and the
seconds that an estimate takes, means over the seeds of each case.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.sonar_accuracy import CASES, RESOLUTION, Case, load_cases
from oddsmap import ConeSensor, FullMapConfig, build_full_map, evaluate

METHODS: dict[str, dict[str, Any]] = {
    "sum-product, default": {},
    "sum-product, 1e-5 nats": {"tolerance": 1e-5, "sweeps": 100},
    "sum-product, J = 0.9": {"tolerance": 1e-5, "sweeps": 100, "coupling": 0.9},
    "map": {"method": "map"},
    "gibbs, 20 samples": {"method": "gibbs", "samples": 20, "burn_in": 10},
    "gibbs, 100 samples": {"method": "gibbs"},
    "gibbs, windows": {"method": "gibbs", "prior_model": "windows"},
    "gibbs, 400 samples": {"method": "gibbs", "samples": 400},
}


def scores(case: Case, settings: dict[str, Any]) -> tuple[float, float, float, float]:
    """Log loss, calibration error, IoU and seconds of one estimate."""
    full_map = build_full_map(
        case.scans,
        RESOLUTION,
        sensor=ConeSensor(**case.sensor),
        settings=FullMapConfig(**settings),
        threads=2,
    )
    found = evaluate(full_map.probability(case.region), case.truth, case.scored)
    assert full_map.report is not None
    return found.log_loss, found.ece, found.iou, full_map.report.integrate_s


def main() -> None:
    """Print the table, a line at a time."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="holds sonar_bench/")
    parser.add_argument("--quick", action="store_true", help="the first seed of each case")
    given = parser.parse_args()
    print("| case | " + " | ".join(METHODS) + " |")
    print("|---" * (len(METHODS) + 1) + "|")
    for name in CASES:
        cases = load_cases(given.data / "sonar_bench", name)
        if not cases:
            parser.error(f"no {name}_*.npz in {given.data / 'sonar_bench'}")
        line = []
        for settings in METHODS.values():
            chosen = cases[:1] if given.quick else cases
            mean = np.mean([scores(case, settings) for case in chosen], axis=0)
            line.append("{:.4f} / {:.4f} / {:.3f}, {:.1f} s".format(*mean))
        print(f"| {name} | " + " | ".join(line) + " |", flush=True)


if __name__ == "__main__":
    main()
