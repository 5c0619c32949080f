# SPDX-License-Identifier: Apache-2.0
"""Sonar of a real robot, eight sensors around it, to an NPZ beam log.

python examples/udacity.py FOLDER udacity.npz
oddsmap build udacity.npz --resolution 0.1 -o udacity.zarr

FOLDER has `measurement.txt` (stamp, 8 ranges in mm, 5110 = no echo) and `poses.txt` (stamp, x, y
in mm, heading in 0.1 degrees), line by line for the same times. The files say neither which sensor
looks where nor how wide it hears. With the first sensor to the left the map is crisper (less
entropy a cell) than with the first to the right; 15 degrees is a guess, common for such sonars.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

HEADINGS_DEG = np.array([90.0, 37.5, 22.5, 7.5, -7.5, -22.5, -37.5, -90.0])
CONE_DEG = 15.0
NO_ECHO_MM = 5110


def main(folder: str, output: str) -> None:
    """Read the two files and write the beams, in metres and radians."""
    readings = np.loadtxt(Path(folder) / "measurement.txt")
    poses = np.loadtxt(Path(folder) / "poses.txt")
    if not np.array_equal(readings[:, 0], poses[:, 0]):
        raise SystemExit("measurement.txt and poses.txt are not of the same times")
    n = len(poses)
    heading = np.deg2rad(poses[:, 3, None] / 10 + HEADINGS_DEG)
    x, y = np.broadcast_to(poses[:, None, 1:3].transpose(2, 0, 1) / 1000, (2, n, 8))
    beams = np.stack([x, y, heading, readings[:, 1:] / 1000], axis=-1).reshape(-1, 4)
    np.savez_compressed(
        output,
        beams=beams,
        scan=np.repeat(np.arange(n), 8),
        cone_deg=CONE_DEG,
        range_max=NO_ECHO_MM / 1000,
    )
    print(f"{n} scans, {len(beams)} beams: {output}")


if __name__ == "__main__":
    main(*sys.argv[1:])
