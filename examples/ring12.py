# SPDX-License-Identifier: Apache-2.0
"""A ring of twelve sonars, one every 30 degrees, to an NPZ beam log.

python examples/ring12.py FOLDER ring12.npz
oddsmap build ring12.npz --resolution 0.1 -o ring12.zarr

FOLDER has `sonar_dataset.csv`: x, y [m], heading [deg], 12 ranges [m], some of them missing.
Sensor i looks 30 i degrees to the left of the heading: of eight ways to mount the ring, only this
one gives a crisp map. Readings around 3.5 m, over a third of all, are a sensor that heard nothing:
they scatter by a few centimetres, so 3.35 m is taken as its limit. How wide it hears is a guess.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

CONE_DEG = 15.0
RANGE_MAX = 3.35


def main(folder: str, output: str) -> None:
    """Read the table and write the beams, in metres and radians."""
    table = np.genfromtxt(Path(folder) / "sonar_dataset.csv", delimiter=",", skip_header=1)
    n = len(table)
    heading = np.deg2rad(table[:, 2, None] + 30.0 * np.arange(12))
    x, y = (np.repeat(table[:, column], 12).reshape(n, 12) for column in (0, 1))
    beams = np.stack([x, y, heading, table[:, 3:]], axis=-1).reshape(-1, 4)
    scan = np.repeat(np.arange(n), 12)
    np.savez_compressed(output, beams=beams, scan=scan, cone_deg=CONE_DEG, range_max=RANGE_MAX)
    print(f"{n} scans, {len(beams)} beams: {output}")


if __name__ == "__main__":
    main(*sys.argv[1:])
