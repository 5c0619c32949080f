# SPDX-License-Identifier: Apache-2.0
"""A drive along a street of any length: PCD scans of a 64-beam lidar, one a metre, and poses.

    python benchmarks/street_log.py FOLDER 3     # kilometres

The street repeats itself after 200 m, so that the scans of one block stand for all others, as links
to the same files; where a scan was taken is in `poses.txt`.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import numpy as np

from benchmarks.town_folder import HEADER
from oddsmap import Pose3
from oddsmap.simulate.lidar3d import Lidar3D
from oddsmap.simulate.solids import Box, Cylinder, Ground, Solid
from oddsmap.simulate.world3d import World3D

BLOCK_M = 200
SEED = 20261128
LIDAR = Lidar3D()


def street() -> World3D:
    """Houses, trees and parked cars on both sides of y = 0, once more before and behind."""
    rng = np.random.default_rng(SEED)
    block: list[tuple[str, float, float, float, float, float]] = []
    for side in (-1, 1):
        x = 0.0
        while x < BLOCK_M - 8:
            length = float(rng.uniform(8, 20))
            setback, height = float(rng.uniform(7, 12)), float(rng.uniform(4, 15))
            block.append(("house", x + length / 2, side * (setback + 5), length, 10.0, height))
            x += length + float(rng.choice([0.0, 0.0, 3.0, 8.0]))
        poles, cars = (rng.uniform(0, BLOCK_M, count).tolist() for count in (12, 8))
        block += [("pole", x, side * 5.5, 0.15, 0.0, 7.0) for x in poles]
        block += [("car", x, side * 4.0, 4.2, 1.8, 1.5) for x in cars]
    solids: list[Solid] = []
    for shift in (-BLOCK_M, 0, BLOCK_M):
        for kind, x, y, length, width, height in block:
            if kind == "pole":
                solids.append(Cylinder(x + shift, y, length, 0.0, height))
            else:
                solids.append(Box(x + shift, y, length, width, 0.0, height))
    return World3D(solids, Ground())


def write_block(folder: Path) -> None:
    """The scans of one block."""
    folder.mkdir(parents=True)
    world, rng = street(), np.random.default_rng(SEED)
    for number in range(BLOCK_M):
        pose = Pose3(np.array([float(number), 0.0, 1.8]), np.eye(3))
        scan = LIDAR.scan(world, pose, rng, returns_only=True)
        points = (scan.directions * scan.ranges[:, None]).astype("<f4")
        content = HEADER.format(len(points)).encode() + points.tobytes()
        (folder / f"{number:06d}.pcd").write_bytes(content)


def street_log(folder: Path, scans: int, work: Path) -> Path:
    """A log of so many scans; its folder is made where it is not there.

    Args:
        folder: of the log.
        scans: how many, one a metre.
        work: where the block is kept.
    """
    block = work / f"street-{SEED}"
    if not block.is_dir():
        made = work / f"street-{SEED}.{os.getpid()}"
        write_block(made)
        made.rename(block)
    if folder.is_dir():
        return folder
    folder.mkdir(parents=True)
    poses = np.zeros((scans, 12))
    poses[:, [0, 5, 10]] = 1.0
    poses[:, 3], poses[:, 11] = np.arange(scans), 1.8
    np.savetxt(folder / "poses.txt", poses, fmt="%.17g")
    for number in range(scans):
        target = (block / f"{number % BLOCK_M:06d}.pcd").resolve()
        (folder / f"{number:07d}.pcd").symlink_to(target)
    return folder


if __name__ == "__main__":
    street_log(Path(sys.argv[1]), round(1000 * float(sys.argv[2])), ROOT / "benchmarks" / ".cache")
