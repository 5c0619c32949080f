# SPDX-License-Identifier: Apache-2.0
"""A street with walkers and cars, before and after `oddsmap.Cleaner`.

python docs/figures/moving_worlds.py        # writes docs/images/moving_worlds.png
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap import BeamSensor, Cleaner, build_map
from oddsmap.simulate import Lidar3D, MovingWorld, drive3d, town, traffic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OUTPUT = Path(__file__).resolve().parent.parent / "images" / "moving_worlds.png"
REACH = 30.0
PERIOD_S = 0.2


class Points(NamedTuple):
    """Returns of all scans, those on the ground left out."""

    place: npt.NDArray[np.float64]
    """x and y [m], shape (n, 2)."""
    moves: npt.NDArray[np.bool_]
    """Which are of walkers and cars, shape (n,)."""
    dynamic: npt.NDArray[np.bool_]
    """Which are called dynamic."""


def points(*, scan_count: int = 60, columns: int = 512) -> Points:
    """Drive through the town and clean what was seen."""
    still = town()
    world, lidar = MovingWorld(still, traffic()), Lidar3D(64, columns, range_max=REACH)
    rng = np.random.default_rng(0)
    scans = []
    for k, pose in enumerate(drive3d(100, ground=still.ground)[:scan_count]):
        scans.append(lidar.scan(world.at(k * PERIOD_S), pose, rng))
    cleaner = Cleaner(build_map(scans, 0.2, sensor=BeamSensor(range_max=REACH)))
    parts = []
    for k, (scan, part) in enumerate(zip(scans, cleaner.label(scans), strict=True)):
        x, y, z = part.points.T
        above = (z - still.ground.height(x, y) > 0.2) & (z < 4.0)
        moves = world.meets_movers(scan, k * PERIOD_S)[part.beam]
        parts.append((part.points[above, :2], moves[above], part.dynamic[above]))
    return Points(*(np.concatenate(of) for of in zip(*parts, strict=True)))


def draw(seen: Points) -> Figure:
    """All points, and those that stay."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.6), layout="constrained")
    all_points, cleaned = figure.subplots(1, 2)
    for axes, title, kept in (
        (all_points, "all points above the ground", np.ones(len(seen.moves), np.bool_)),
        (cleaned, "without what is called dynamic", ~seen.dynamic),
    ):
        for mine, colour in ((kept & ~seen.moves, "0.25"), (kept & seen.moves, "tab:red")):
            axes.plot(*seen.place[mine].T, ",", color=colour)
        axes.set(title=title, xlim=(-42, 42), ylim=(-30, 30), aspect="equal")
        axes.set(xlabel="x [m]", ylabel="y [m]")
    return figure


if __name__ == "__main__":
    draw(points()).savefig(OUTPUT, dpi=110)
    sys.stdout.write(f"{OUTPUT}\n")
