# SPDX-License-Identifier: Apache-2.0
"""How well what moved is found: `oddsmap.Cleaner` beside the rules of OctoMap and DUFOMap.

    python benchmarks/dynamic.py                  # two minutes of CPU time
    python benchmarks/dynamic.py --all            # also GF and DUFOMap with larger cells
    python benchmarks/dynamic.py --seed 3         # another town, other traffic

A lidar drives through the town of `oddsmap.simulate`, where walkers and cars go about; which
returns are of them is known. SA and DA are the shares of static and of dynamic points that are
called so, AA the square root of their product: the measures of Zhang et al. (2023), A Dynamic
Points Removal Benchmark in Point Cloud Maps. Each with exact poses, and with poses that are off by
a normal error of 2 cm along each axis. CPU time has the map in it, but not the outliers of GF.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "src"), str(ROOT)]

import oddsmap
from benchmarks.peers import dynamic_rules as peers
from oddsmap.simulate import Lidar3D, MovingWorld, drive3d, town, traffic

BoolArray = npt.NDArray[np.bool_]
RANGE_MAX = 30.0
SCANS, PERIOD_S = 60, 0.2


def drive(seed: int) -> tuple[list[oddsmap.Scan], list[BoolArray]]:
    """Scans of a town with traffic, and which of their returns are of what moves."""
    still = town(seed)
    world, lidar = MovingWorld(still, traffic(seed)), Lidar3D(64, 512, range_max=RANGE_MAX)
    rng = np.random.default_rng(seed)
    scans, truth = [], []
    for k, pose in enumerate(drive3d(100, ground=still.ground)[:SCANS]):
        scan = lidar.scan(world.at(k * PERIOD_S), pose, rng)
        scans.append(scan)
        truth.append(world.meets_movers(scan, k * PERIOD_S)[np.isfinite(scan.ranges)])
    return scans, truth


def moved(scans: Sequence[oddsmap.Scan], sigma: float, seed: int) -> list[oddsmap.Scan]:
    """The same scans with poses that are off."""
    rng = np.random.default_rng(seed + 1)
    return [
        dataclasses.replace(
            scan,
            map_from_sensor=oddsmap.Pose3(
                scan.map_from_sensor.rotation,
                scan.map_from_sensor.translation + rng.normal(0.0, sigma, 3),
            ),
            trusted=True,
        )
        for scan in scans
    ]


def ours(scans: Sequence[oddsmap.Scan], resolution: float) -> list[BoolArray]:
    """Dynamic returns of each scan, by `oddsmap.Cleaner` with its defaults."""
    sensor = oddsmap.BeamSensor(range_max=RANGE_MAX)
    cleaner = oddsmap.Cleaner(oddsmap.build_map(scans, resolution, sensor=sensor))
    return [part.dynamic for part in cleaner.label(scans)]


def score(found: Sequence[BoolArray], truth: Sequence[BoolArray]) -> tuple[float, float, float]:
    """SA, DA and AA [%]."""
    dynamic, really = np.concatenate(found), np.concatenate(truth)
    sa, da = float((~dynamic[~really]).mean()), float(dynamic[really].mean())
    return 100 * sa, 100 * da, 100 * (sa * da) ** 0.5


_MORE = ("OctoMap GF, 0.2 m", "DUFOMap, 0.2 m")

Method = Callable[[Sequence[oddsmap.Scan]], list[BoolArray]]


def methods(scans: Sequence[oddsmap.Scan]) -> dict[str, Method]:
    """What is compared; what a scan alone says is worked out once, whatever its pose."""
    masks = peers.grounds_and_outliers(scans)
    return {
        "oddsmap.Cleaner, 0.2 m": lambda log: ours(log, 0.2),
        "oddsmap.Cleaner, 0.1 m": lambda log: ours(log, 0.1),
        "OctoMap, 0.1 m": lambda log: peers.octomap(log, 0.1),
        "OctoMap, 0.2 m": lambda log: peers.octomap(log, 0.2),
        "OctoMap GF, 0.1 m": lambda log: peers.octomap_gf(log, 0.1, masks),
        "OctoMap GF, 0.2 m": lambda log: peers.octomap_gf(log, 0.2, masks),
        "DUFOMap, 0.1 m": lambda log: peers.dufomap(log, 0.1),
        "DUFOMap, 0.2 m": lambda log: peers.dufomap(log, 0.2),
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=0, help="of the town and its traffic")
    parser.add_argument("--all", action="store_true", help="also the slow ones at 0.2 m")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    given = parser.parse_args()
    scans, truth = drive(given.seed)
    count, dynamic = sum(map(len, truth)), int(sum(part.sum() for part in truth))
    print(f"{len(scans)} scans, {count} returns, {dynamic} of them of what moves")
    print(f"{'':26} {'poses exact':^20}   {'poses off by 2 cm':^20}   CPU")
    print(f"{'':26} {'SA':>6} {'DA':>6} {'AA':>6}   {'SA':>6} {'DA':>6} {'AA':>6}")
    found = {}
    noisy = moved(scans, 0.02, given.seed)
    ours(scans[:2], 0.2)  # compiled
    for name, method in methods(scans).items():
        if name in _MORE and not given.all:
            continue
        start = time.process_time()
        rows = [score(method(log), truth) for log in (scans, noisy)]
        spent = (time.process_time() - start) / 2
        found[name] = {"exact": rows[0], "2 cm": rows[1], "cpu_s": spent}
        words = "   ".join(" ".join(f"{x:6.2f}" for x in row) for row in rows)
        print(f"{name:26} {words} {spent:5.1f} s", flush=True)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
