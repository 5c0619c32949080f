# SPDX-License-Identifier: Apache-2.0
"""What a projection calls free and occupied, against the truth of simulated worlds.

    python benchmarks/projection.py                # four worlds, about a minute
    python benchmarks/projection.py --only room

Each world is mapped from simulated scans and projected with ground="relative", band 0.2 to 1.8 m.
Floor: columns in which nothing stands, nor in the eight around, up to so many metres from the way,
seen in the band. Things: columns that a solid fills to half or more, likewise. Missed: things that
are called free. The true columns come from the solids, 4 x 4 points to a column.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from oddsmap import Pose3, State, build_map, project
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.scans.measurement import Measurement
from oddsmap.simulate import (
    Box,
    Cylinder,
    DepthCamera,
    Disc,
    Ground,
    Lidar3D,
    Rectangle,
    Solid,
    World3D,
    drive3d,
    office_drive,
    office_plan,
    room,
    room_walk,
    town,
)

BAND = (0.2, 1.8)
NEAR = 5.0  # [m] from the way
RULES: dict[str, dict[str, Any]] = {
    "largest": {"rule": "largest"},
    "slabs of 0.2 m": {"slab": 0.2},
    "slabs of 0.3 m": {},
    "slabs of 0.4 m": {"slab": 0.4},
    "one slab": {"slab": math.inf},
}
FloatArray = npt.NDArray[np.float64]


@dataclass
class Trip:
    """A world, its scans, and the way that they were taken on, x and y [m]."""

    world: World3D
    scans: list[Measurement]
    way: FloatArray
    resolution: float


def office_of_space() -> World3D:
    """The office plan with heights: walls and discs to the ceiling, furniture of 0.45 to 1.9 m."""
    things: list[Solid] = [Box(10.0, 7.0, 22.0, 16.0, 2.6, 2.8)]
    tops = (0.45, 0.9, 1.1, 1.9)
    for k, shape in enumerate(office_plan().obstacles):
        if isinstance(shape, Disc):
            things.append(Cylinder(shape.x, shape.y, shape.radius, 0.0, 2.6))
        elif isinstance(shape, Rectangle):
            length, width = shape.x_max - shape.x_min, shape.y_max - shape.y_min
            thin = min(length, width) < 0.2
            middle = (shape.x_min + shape.x_max) / 2, (shape.y_min + shape.y_max) / 2
            things.append(Box(*middle, length, width, 0.0, 2.6 if thin else tops[k % 4]))
    return World3D(things, Ground())


def of_town(rings: int, columns: int, poses: int) -> Trip:
    """A drive around the town."""
    world, rng = town(1), np.random.default_rng(3)
    low = math.radians(-25 if rings > 16 else -15)
    lidar = Lidar3D(ring_count=rings, column_count=columns, elevation_min=low)
    way = np.array([pose.translation[:2] for pose in drive3d(400)])
    scans = [lidar.scan(world, pose, rng) for pose in drive3d(poses, ground=world.ground)]
    return Trip(world, list(scans), way, 0.1)


def of_office(poses: int) -> Trip:
    """A robot with 16 rings, 0.6 m above the floor, in all rooms."""
    world, rng = office_of_space(), np.random.default_rng(3)
    lidar = Lidar3D(
        ring_count=16, column_count=900, elevation_min=math.radians(-15), range_max=30.0
    )
    drive = office_drive()
    scans: list[Measurement] = []
    for pose in drive[:: max(1, len(drive) // poses)]:
        c, s = math.cos(pose.theta), math.sin(pose.theta)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        scans.append(lidar.scan(world, Pose3(turn, np.array([pose.x, pose.y, 0.6])), rng))
    return Trip(world, scans, np.array([(pose.x, pose.y) for pose in drive]), 0.1)


def of_room(poses: int) -> Trip:
    """A depth camera carried through a furnished room."""
    world, camera, rng = room(), DepthCamera(), np.random.default_rng(3)
    scans: list[Measurement] = [camera.scan(world, pose, rng) for pose in room_walk(poses)]
    way = np.array([pose.translation[:2] for pose in room_walk(200)])
    return Trip(world, scans, way, 0.05)


TRIPS: dict[str, Callable[[], Trip]] = {
    "town, 64 rings, 30 scans": lambda: of_town(64, 256, 30),
    "town, 16 rings, 100 scans": lambda: of_town(16, 900, 100),
    "office, 16 rings, 200 scans": lambda: of_office(200),
    "room, depth camera, 30 scans": lambda: of_room(30),
}


def filled(world: World3D, plane: ProbabilityMap, points: int = 4) -> FloatArray:
    """Which share of each column a solid fills somewhere in the band, shape (ny, nx)."""
    ny, nx = plane.probability.shape
    full = np.zeros((ny * points, nx * points), np.bool_)
    step = plane.resolution / points
    ground = world.ground or Ground()
    for solid in world.solids:
        reach = solid.radius + plane.resolution
        low = [
            math.floor((c - reach - o) / step)
            for c, o in zip((solid.x, solid.y), plane.origin, strict=True)
        ]
        high = [
            math.ceil((c + reach - o) / step)
            for c, o in zip((solid.x, solid.y), plane.origin, strict=True)
        ]
        i = np.arange(max(0, low[0]), min(nx * points, high[0]))
        j = np.arange(max(0, low[1]), min(ny * points, high[1]))
        if not len(i) or not len(j):
            continue
        x, y = np.meshgrid(plane.origin[0] + (i + 0.5) * step, plane.origin[1] + (j + 0.5) * step)
        above = ground.height(x.ravel(), y.ravel())
        inside = solid.outline_contains(np.stack([x.ravel(), y.ravel()], axis=1))
        inside &= (solid.z_min < above + BAND[1]) & (solid.z_max > above + BAND[0])
        full[np.ix_(j, i)] |= inside.reshape(x.shape)
    share: FloatArray = full.reshape(ny, points, nx, points).mean(axis=(1, 3))
    return share


def shares(trip: Trip) -> dict[str, dict[str, float]]:
    """For each rule: floor free, borders and insides missed, borders occupied, all undecided."""
    from scipy.ndimage import binary_dilation, distance_transform_edt

    grid = build_map(trip.scans, trip.resolution)
    planes = {name: project(grid, *BAND, ground="relative", **rule) for name, rule in RULES.items()}
    first = next(iter(planes.values()))
    share = filled(trip.world, first)
    way = np.floor((trip.way - first.origin) / trip.resolution).astype(np.int64)
    off = np.ones(share.shape, np.bool_)
    off[way[:, 1], way[:, 0]] = False
    near = distance_transform_edt(off) * trip.resolution <= NEAR
    seen = first.observed & near
    around = np.ones((3, 3))
    floor, things = seen & ~binary_dilation(share > 0, around), seen & (share >= 0.5)
    border = binary_dilation(share == 0, around)
    borders, insides = things & border, things & ~border
    found = {}
    for name, plane in planes.items():
        state = plane.state()
        found[name] = {
            "free": float((state[floor] == State.FREE).mean()),
            "missed": float((state[borders] == State.FREE).mean()),
            "insides": float((state[insides] == State.FREE).mean()),
            "occupied": float((state[borders] == State.OCCUPIED).mean()),
            "undecided": float((state[first.observed] == State.UNDECIDED).mean()),
        }
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", metavar="WORD", help="worlds with this word in their name")
    words = parser.parse_args(arguments)
    print("| world | rule | floor free | borders missed | insides missed | borders occupied | "
          "all undecided |\n|---|---|---|---|---|---|---|")  # fmt: skip
    for name, make in TRIPS.items():
        if words.only and words.only not in name:
            continue
        for rule, found in shares(make()).items():
            numbers = " | ".join(f"{100 * value:.1f} %" for value in found.values())
            print(f"| {name} | {rule} | {numbers} |", flush=True)


if __name__ == "__main__":
    main()
