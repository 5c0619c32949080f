# SPDX-License-Identifier: Apache-2.0
"""A hall, mapped by a spinning LIDAR on a robot that drives and turns: scans at once, and deskewed.

python docs/figures/deskew.py        # writes docs/images/deskew.png and prints what it shows
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from oddsmap import EvidenceMap, Pose3, Scan, build_map
from oddsmap.poses.at_times import PoseTrack
from oddsmap.poses.trajectory import Trajectory
from oddsmap.scans.deskew import deskew
from oddsmap.simulate import Box, Cylinder, Lidar3D, World3D

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OUTPUT = Path(__file__).resolve().parent.parent / "images" / "deskew.png"
RESOLUTION = 0.05
PERIOD_NS = 100_000_000
POSES_EVERY_NS = 20_000_000
HALF_LENGTH, HALF_WIDTH = 6.0, 4.0  # of the hall [m]


class Maps(NamedTuple):
    """The same readings, taken in three ways."""

    at_once: EvidenceMap
    deskewed: EvidenceMap
    standing: EvidenceMap
    """Of a robot that stops for each scan: what there is to reach."""


def hall() -> World3D:
    """Four walls, a few pillars and crates."""
    length, width = HALF_LENGTH, HALF_WIDTH
    walls = [
        Box(0.0, side * (width + 0.1), 2 * length + 0.4, 0.2, 0.0, 3.0) for side in (-1, 1)
    ] + [Box(side * (length + 0.1), 0.0, 0.2, 2 * width, 0.0, 3.0) for side in (-1, 1)]
    pillars = [Cylinder(x, y, 0.2, 0.0, 3.0) for x in (-3.0, 3.0) for y in (-2.0, 2.0)]
    crates = [Box(0.3, -3.2, 1.0, 0.6, 0.0, 1.8, 0.4), Box(-4.6, 0.4, 0.8, 0.8, 0.0, 1.8, 0.8)]
    return World3D([*walls, *pillars, *crates])


def pose_at(time_ns: int) -> Pose3:
    """A figure of eight, driven at about 1 m/s, while the robot turns to and fro at 1.6 rad/s."""
    t = time_ns / 1e9
    yaw = 0.4 * t + 1.2 * math.sin(1.0 * t)
    turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return Pose3.from_quaternion_xyzw((2.1 * math.sin(0.4 * t), 0.9 * math.sin(0.8 * t), 1.0), turn)


def drive(lidar: Lidar3D, scan_count: int, *, moves: bool = True) -> list[Scan]:
    """Scans as a driver hands them on, one each second period."""
    world, rng = hall(), np.random.default_rng(0)
    column_ns = PERIOD_NS // lidar.column_count
    scans = []
    for k in range(scan_count):
        start = 2 * k * PERIOD_NS
        times = [start + moves * c * column_ns for c in range(lidar.column_count)]
        poses = [pose_at(time) for time in times]
        scans.append(lidar.sweep(world, poses, rng, stamp_ns=start, column_ns=column_ns))
    return scans


def deskewed(scans: Sequence[Scan]) -> list[Scan]:
    """Each beam from where the sensor was, by poses that come 50 times a second."""
    last = max(int(scan.beam_times_ns.max()) for scan in scans if scan.beam_times_ns is not None)
    stamps = np.arange(0, last + POSES_EVERY_NS, POSES_EVERY_NS)
    known = [pose_at(int(stamp)) for stamp in stamps]
    track = PoseTrack(
        Trajectory(
            np.array([pose.translation for pose in known]),
            np.array([pose.rotation for pose in known]),
            stamps,
        )
    )
    return [
        deskew(scan, scan.map_from_sensor, lambda times: track.at(times, POSES_EVERY_NS))[0]
        for scan in scans
        if isinstance(scan.map_from_sensor, Pose3)
    ]


def maps(*, ring_count: int = 16, column_count: int = 360, scan_count: int = 60) -> Maps:
    """Map the hall in each of the ways."""
    up = math.radians(15)
    lidar = Lidar3D(ring_count, column_count, -up, up, range_max=20.0, sigma=0.01)
    moving, standing = drive(lidar, scan_count), drive(lidar, scan_count, moves=False)
    return Maps(
        build_map(moving, RESOLUTION),
        build_map(deskewed(moving), RESOLUTION),
        build_map(standing, RESOLUTION),
    )


def wall_thickness(grid: EvidenceMap) -> float:
    """How thick the four walls are in the map [m]: 90 % of the hits lie within that.

    Of hits between 0.5 and 1.5 m above the ground that lie nearer to a wall than anything else.
    """
    index, hits, _ = grid.cells()[:3]
    x, y, z = ((index + 0.5) * RESOLUTION).T
    off = np.minimum(np.abs(np.abs(x) - HALF_LENGTH), np.abs(np.abs(y) - HALF_WIDTH))
    inside_out = np.where(
        np.abs(np.abs(x) - HALF_LENGTH) < np.abs(np.abs(y) - HALF_WIDTH),
        np.abs(x) - HALF_LENGTH,
        np.abs(y) - HALF_WIDTH,
    )
    wall = (hits > 0) & (off < 0.6) & (z > 0.5) & (z < 1.5)
    order = np.argsort(inside_out[wall])
    total = np.cumsum(hits[wall][order].astype(np.float64))
    low, high = np.searchsorted(total, [0.05 * total[-1], 0.95 * total[-1]])
    ways = inside_out[wall][order]
    return float(ways[min(high, len(ways) - 1)] - ways[low]) + RESOLUTION


def draw(made: Maps) -> Figure:
    """Draw the maps side by side, seen from above."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.2), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 2, sharey=True)
    names = ("scans taken at once", "deskewed")
    for axes, name, grid in zip(panels, names, (made.at_once, made.deskewed), strict=True):
        index, hits, passes = grid.cells()[:3]
        seen = hits > 0
        lo, hi = index[seen].min(axis=0), index[seen].max(axis=0) + 1
        share = np.zeros((hi - lo)[:2][::-1])
        belief = hits[seen] / (hits[seen] + passes[seen])
        x, y = (index[seen] - lo)[:, 0], (index[seen] - lo)[:, 1]
        np.maximum.at(share, (y, x), belief)
        box = (lo[0], hi[0], lo[1], hi[1])
        extent = [float(edge * RESOLUTION) for edge in box]
        axes.imshow(share, cmap="gray_r", origin="lower", extent=extent, vmin=0.0, vmax=1.0)
        axes.set_xlim(-HALF_LENGTH - 0.7, HALF_LENGTH + 0.7)
        axes.set_ylim(-HALF_WIDTH - 0.7, HALF_WIDTH + 0.7)
        axes.set_title(f"{name}: walls {100 * wall_thickness(grid):.0f} cm thick", fontsize=9)
        axes.set_xlabel("x [m]")
    panels[0].set_ylabel("y [m]")
    return figure


def table(made: Maps) -> str:
    """What the maps show, a line each."""
    rows = [
        f"{name:<9} walls {100 * wall_thickness(grid):.0f} cm thick, {len(grid.cells()[0]):,} cells"
        for name, grid in made._asdict().items()
    ]
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    made = maps()
    sys.stdout.write(table(made))
    draw(made).savefig(OUTPUT, metadata={"Software": "oddsmap"})
