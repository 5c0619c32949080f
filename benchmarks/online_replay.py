# SPDX-License-Identifier: Apache-2.0
"""What replay and the settled prior bring to an online full map.

    python benchmarks/online_replay.py --data DIR             # about two minutes
    python benchmarks/online_replay.py --data DIR --quick     # one seed of each case

DIR holds sonar_bench/. Prints log loss over the `scored` cells, means over the seeds.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.sonar_accuracy import RESOLUTION, Case, load_cases
from oddsmap import ConeSensor, OnlineFullMap, evaluate
from oddsmap.config.config import Config, MapConfig
from oddsmap.full_map import online_beliefs

CASES = ("E2", "E5", "E6")
# Settings of the estimator, and whether new blocks get their prior before beams meet them.
VARIANTS: dict[str, tuple[dict[str, Any], bool]] = {
    "default": ({}, True),
    "100 old scans": ({"reservoir": 100}, True),
    "no replay": ({"replay": 0}, True),
    "prior not settled": ({}, False),
    "neither": ({"replay": 0}, False),
}


def loss(case: Case, settings: dict[str, Any], settled: bool) -> float:
    """Log loss of the map of one log."""
    config = Config(map=MapConfig(resolution=RESOLUTION), sensor=ConeSensor(**case.sensor))
    estimator = OnlineFullMap(config, **settings)
    if settled:
        estimator.add_scans(case.scans)
    else:
        with mock.patch.object(online_beliefs, "settle_new_blocks"):
            estimator.add_scans(case.scans)
    return evaluate(estimator.view().probability(case.region), case.truth, case.scored).log_loss


def main() -> None:
    """Print the table, a line at a time."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="holds sonar_bench/")
    parser.add_argument("--quick", action="store_true", help="the first seed of each case")
    given = parser.parse_args()
    print("| case, scans | " + " | ".join(VARIANTS) + " |")
    print("|---" * (len(VARIANTS) + 1) + "|")
    for name in CASES:
        cases = load_cases(given.data / "sonar_bench", name)
        if not cases:
            parser.error(f"no {name}_*.npz in {given.data / 'sonar_bench'}")
        chosen = cases[:1] if given.quick else cases
        means = [
            np.mean([loss(case, *variant) for case in chosen]) for variant in VARIANTS.values()
        ]
        told = f"{name}, {len(chosen[0].scans)}"
        print(f"| {told} | " + " | ".join(f"{mean:.4f}" for mean in means) + " |", flush=True)


if __name__ == "__main__":
    main()
