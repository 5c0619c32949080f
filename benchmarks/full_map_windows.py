# SPDX-License-Identifier: Apache-2.0
"""Does the window prior predict real sonar readings better that the map has not seen?

    python examples/udacity.py FOLDER udacity.npz
    python benchmarks/full_map_windows.py udacity.npz

Held back: every fifth scan, and each fifth of the log in turn. Prints the mean log likelihood of
held-out readings [nats a beam] under the sensor model that `oddsmap calibrate` finds for that log.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from oddsmap import ConeSensor, FullMapConfig, build_full_map, open_log, score_map
from oddsmap.sensors.registry import stated_of_sensor

_CALIBRATED = {
    "detection": 0.27, "p_dropout": 0.21, "p_random": 0.015, "sigma": 0.031, "cone_deg": 19.0
}  # fmt: skip
_METHODS = {
    "sum-product": FullMapConfig(),
    "gibbs, ising": FullMapConfig(method="gibbs"),
    "gibbs, windows": FullMapConfig(method="gibbs", prior_model="windows"),
}


def main() -> None:
    """Print a line for each method."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log", type=Path)
    log = open_log(parser.parse_args().log)
    scans = list(log)
    said = stated_of_sensor(log)
    said.pop("kind")
    sensor = ConeSensor(**(said | _CALIBRATED))
    fifth = np.arange(len(scans)) * 5 // len(scans)
    for name, settings in _METHODS.items():
        found = []
        for held in [np.arange(len(scans)) % 5 == 0, *(fifth == k for k in range(5))]:
            mapped = [scan for scan, out in zip(scans, held, strict=True) if not out]
            others = [scan for scan, out in zip(scans, held, strict=True) if out]
            full_map = build_full_map(mapped, 0.1, sensor=sensor, settings=settings)
            found.append(score_map(full_map, others, sensor).log_likelihood)
        print(f"{name:15} scans {found[0]:.3f}   blocks {np.mean(found[1:]):.3f}", flush=True)


if __name__ == "__main__":
    main()
