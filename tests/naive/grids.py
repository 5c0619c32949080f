# SPDX-License-Identifier: Apache-2.0
"""What a grid seen at a pose says of cells, cell by cell: the oracle of `OverheadSensor`."""

from __future__ import annotations

import math
from collections.abc import Iterable

from oddsmap.scans.grid_scan import GridScan

Cell = tuple[int, int]


def pixel_of(scan: GridScan, x: float, y: float) -> Cell | None:
    """Row and column of the pixel that holds a point of the map [m]; None outside the grid."""
    pose = scan.map_from_sensor
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    forward = c * (x - pose.x) + s * (y - pose.y)
    left = c * (y - pose.y) - s * (x - pose.x)
    place = []
    for along, start, count in (
        (left, scan.corner[1], scan.seen.shape[0]),
        (forward, scan.corner[0], scan.seen.shape[1]),
    ):
        at = (along - start) / scan.resolution
        number = round(at) if abs(at - round(at)) <= 1e-6 else math.floor(at)
        if not 0 <= number < count:
            return None
        place.append(number)
    return place[0], place[1]


def readings(scan: GridScan, resolution: float, cells: Iterable[Cell]) -> dict[Cell, float]:
    """What is said of cells, by cell; those of which nothing is said are left out."""
    said = {}
    for ix, iy in cells:
        pixel = pixel_of(scan, (ix + 0.5) * resolution, (iy + 0.5) * resolution)
        if pixel is not None and not math.isnan(scan.seen[pixel]):
            said[ix, iy] = float(scan.seen[pixel])
    return said
