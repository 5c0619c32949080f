# SPDX-License-Identifier: Apache-2.0
"""Projective integration, one cell after the other: the readable version of its kernels."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import numpy.typing as npt

from oddsmap.scans.depth_image import DepthScan
from oddsmap.sensors.beam import BeamSensor
from tests.naive import beams

Cell = tuple[int, ...]

# A depth has been rounded to float32; a projection, to float64.
DEPTH_ROUNDING = 1e-6
PIXEL_ROUNDING = 1e-8


def clear_depths(scan: DepthScan, sensor: BeamSensor) -> npt.NDArray[np.float64]:
    """Up to which depth each pixel clears [m], NaN where it does not; shape (h, w)."""
    far, _, _ = beams.reach(sensor, scan.to_scan().ranges)
    return far.reshape(scan.depth.shape) / scan.camera.range_per_depth


def free_cells(
    scan: DepthScan, resolution: float, sensor: BeamSensor
) -> tuple[set[Cell], set[Cell]]:
    """Cells whose centre lies before the surface by half a diagonal, in the nearest pixel.

    Returns:
        The free cells, whether or not there is a hit in them; and those among all cells for which
        rounding may decide.
    """
    camera, pose = scan.camera, scan.map_from_sensor
    depths = clear_depths(scan, sensor)
    farthest = np.nanmax(depths, initial=0.0) * camera.range_per_depth.max()
    # Half a pixel beyond the outermost rays, and some cells more.
    reach = farthest * (1 + 0.5 / abs(camera.fx) + 0.5 / abs(camera.fy)) + 3 * resolution
    lo = np.floor((pose.translation - reach) / resolution).astype(int).tolist()
    hi = np.ceil((pose.translation + reach) / resolution).astype(int).tolist()
    half = math.sqrt(3) / 2 * resolution
    (a, b, c), origin = pose.rotation.tolist(), pose.translation.tolist()
    free, doubtful = set(), set()
    for cell in product(*map(range, lo, hi)):
        u = (cell[0] + 0.5) * resolution - origin[0]
        v = (cell[1] + 0.5) * resolution - origin[1]
        w = (cell[2] + 0.5) * resolution - origin[2]
        z = a[2] * u + b[2] * v + c[2] * w
        if z <= 1e-9:
            continue
        x = a[0] * u + b[0] * v + c[0] * w
        y = a[1] * u + b[1] * v + c[1] * w
        column, row = camera.cx + camera.fx * x / z + 0.5, camera.cy + camera.fy * y / z + 0.5
        margin = PIXEL_ROUNDING * max(1.0, 1.0 / z)
        near_border = min(abs(column - round(column)), abs(row - round(row))) < margin
        if near_border and -1 < column < camera.width + 1 and -1 < row < camera.height + 1:
            doubtful.add(cell)
        if not (0 <= column < camera.width and 0 <= row < camera.height):
            continue
        before = depths[math.floor(row), math.floor(column)] - z - half
        if abs(before) < DEPTH_ROUNDING:
            doubtful.add(cell)
        if before > 0:  # not where it is NaN
            free.add(cell)
    return free, doubtful


def hit_cells(scan: DepthScan, resolution: float, sensor: BeamSensor) -> set[Cell]:
    """The end cells of the pixels with a return, as of any beam."""
    ends = beams.segments(sensor, [scan.to_scan()])
    return {tuple(math.floor(x / resolution) for x in end.tolist()) for end, _, hit in ends if hit}
