# SPDX-License-Identifier: Apache-2.0
"""Worlds from which the window prior of full maps is learnt, and others on which it is tried.

Part of `window_prior.py`. Three families of 15 x 15 m, drawn on a raster of 0.025 m; a cell of
0.1 m is occupied where at least half of it is.

- rooms: walls of 0.1 to 0.3 m that divide a house in two, again and again, a door in each;
  furniture.
- clutter: boxes, turned boxes and discs in one walled hall.
- blobs: smooth noise above a threshold, and discs like trunks: no straight line anywhere.

Half of the rooms and halls are drawn in whole decimetres, as builders do, and so lie on the cells;
the others lie anywhere. None of this is taken from the worlds of sonar_bench.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from oddsmap import Pose2, Scan
from oddsmap.simulate import Sonar2D

__all__ = ["CELL", "FAMILIES", "FINE", "cells_of", "drive", "world"]

Bools = npt.NDArray[np.bool_]
Rng = np.random.Generator
Box = tuple[float, float, float, float]

SIDE, FINE, CELL = 15.0, 0.025, 0.1
_COUNT = round(SIDE / FINE)
_AXIS = (np.arange(_COUNT) + 0.5) * FINE
_X, _Y = np.meshgrid(_AXIS, _AXIS)
# A robot needs so much room [m], and takes a scan every so often [m].
_CLEAR, _STEP = 0.35, 0.1


def world(family: str, seed: int) -> Bools:
    """A world on the fine raster, shape (ny, nx)."""
    rng = np.random.default_rng([list(FAMILIES).index(family), seed])
    return FAMILIES[family](rng, 0.1 if seed % 2 == 0 else 1e-9)


def cells_of(fine: Bools) -> Bools:
    """The cells that are occupied by half or more, shape (150, 150)."""
    by = round(CELL / FINE)
    shape = fine.shape[0] // by, by, fine.shape[1] // by, by
    return np.asarray(fine.reshape(shape).mean(axis=(1, 3)) >= 0.5)


def drive(fine: Bools, sonar: Sonar2D, scan_count: int, rng: Rng, resolution: float) -> list[Scan]:
    """Scans of a robot that goes straight on until something is near, then elsewhere."""
    from scipy.ndimage import distance_transform_edt, label

    room = distance_transform_edt(~fine) * resolution > _CLEAR
    parts, _ = label(room)
    room = parts == np.argmax(np.bincount(parts[room]))
    y, x = (rng.choice(np.argwhere(room)) + 0.5) * resolution
    heading = rng.uniform(-math.pi, math.pi)
    scans: list[Scan] = []
    while len(scans) < scan_count:
        to_x, to_y = x + _STEP * math.cos(heading), y + _STEP * math.sin(heading)
        if room[int(to_y / resolution), int(to_x / resolution)]:
            x, y = to_x, to_y
            scans.append(sonar.scan(fine, resolution, Pose2(x, y, heading), rng))
        else:
            heading = rng.uniform(-math.pi, math.pi)
    return scans


def _rooms(rng: Rng, grid: float) -> Bools:
    fine = _hall(0.2)
    doors: list[tuple[float, float]] = []
    _divide(fine, (0.2, 0.2, SIDE - 0.2, SIDE - 0.2), int(rng.integers(2, 6)), rng, grid, doors)
    near_door = np.zeros_like(fine)
    for x, y in doors:
        near_door |= (np.abs(_X - x) < 0.5) & (np.abs(_Y - y) < 0.5)
    return (fine & ~near_door) | _furniture(rng, grid, int(rng.integers(8, 40)), near_door)


def _divide(
    fine: Bools, box: Box, depth: int, rng: Rng, grid: float, doors: list[tuple[float, float]]
) -> None:
    x0, y0, x1, y1 = box
    if depth == 0 or max(x1 - x0, y1 - y0) < 4.5:
        return
    thick = float(rng.choice([0.1, 0.2, 0.2, 0.3]))
    across = x1 - x0 > y1 - y0
    low, high, begin, end = (x0, x1, y0, y1) if across else (y0, y1, x0, x1)
    at = _on(grid, rng.uniform(low + 1.8, high - 1.8))
    door = _on(grid, rng.uniform(begin + 0.6, end - 0.6))
    along = _X if across else _Y
    fine |= (along >= at) & (along < at + thick) & _inside(box)
    doors.append((at + thick / 2, door) if across else (door, at + thick / 2))
    one, other = (
        ((x0, y0, at, y1), (at + thick, y0, x1, y1))
        if across
        else ((x0, y0, x1, at), (x0, at + thick, x1, y1))
    )
    for part in (one, other):
        _divide(fine, part, depth - 1, rng, grid, doors)


def _clutter(rng: Rng, grid: float) -> Bools:
    return _hall(0.2) | _furniture(rng, grid, int(rng.integers(20, 70)), np.zeros(_X.shape, bool))


def _blobs(rng: Rng, _: float) -> Bools:
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(rng.standard_normal(_X.shape), rng.uniform(10.0, 30.0))
    fine = _hall(0.1) | (smooth > np.quantile(smooth, rng.uniform(0.78, 0.92)))
    for _ in range(60):
        x, y = rng.uniform(0.3, SIDE - 0.3, 2)
        fine |= (_X - x) ** 2 + (_Y - y) ** 2 <= rng.uniform(0.05, 0.25) ** 2
    return np.asarray(fine)


def _furniture(rng: Rng, grid: float, count: int, keep_clear: Bools) -> Bools:
    fine = np.zeros(_X.shape, np.bool_)
    for _ in range(count):
        x, y = (_on(grid, v) for v in rng.uniform(0.3, SIDE - 0.3, 2))
        width, height = (_on(grid, v) for v in rng.uniform(0.1, 1.4, 2))
        kind, angle = rng.random(), rng.uniform(0.0, math.pi)
        if kind < 0.5:
            thing = _inside((x, y, x + width, y + height))
        elif kind < 0.75:
            along = (_X - x) * math.cos(angle) + (_Y - y) * math.sin(angle)
            beside = (_Y - y) * math.cos(angle) - (_X - x) * math.sin(angle)
            thing = (np.abs(along) <= width / 2) & (np.abs(beside) <= height / 2)
        else:
            thing = (_X - x) ** 2 + (_Y - y) ** 2 <= rng.uniform(0.08, 0.35) ** 2
        if not (thing & keep_clear).any():
            fine |= thing
    return fine


def _hall(thick: float) -> Bools:
    return ~_inside((thick, thick, SIDE - thick, SIDE - thick))


def _inside(box: Box) -> Bools:
    x0, y0, x1, y1 = box
    return np.asarray((x0 <= _X) & (x1 > _X) & (y0 <= _Y) & (y1 > _Y))


def _on(grid: float, value: float) -> float:
    return round(value / grid) * grid


FAMILIES: dict[str, Callable[[Rng, float], Bools]] = {
    "rooms": _rooms,
    "clutter": _clutter,
    "blobs": _blobs,
}
