# SPDX-License-Identifier: Apache-2.0
"""Which points of a log are dynamic, by the rules of OctoMap and of DUFOMap: slow and obvious.

Sources: Hornung et al., OctoMap (Autonomous Robots 34, 2013), with the settings of the benchmark of
Zhang, Duberg, Geng, Jia, Wang and Jensfelt, A Dynamic Points Removal Benchmark in Point Cloud Maps
(ITSC 2023): cells of 0.1 m, hit 0.7, miss 0.4, clamped to 0.12 and 0.97. A point is dynamic where
its cell is not occupied (p > 0.5) in the end. "GF": the ground is found scan by scan as the level
plane with the most points within 4 cm, kept, and its rays clear without marking; points that are
outliers in their scan (their mean distance to 50 neighbours lies more than one standard deviation
above that of all) are not mapped.

Duberg, Zhang, Jia and Jensfelt, DUFOMap (RA-L 9, 2024): a cell is void if in some one scan rays
passed it, no ray ended in it or had the last d_s of its way there, and no cell within d_p cells of
it was left unknown by that scan. A point is dynamic where its cell was void in any scan. As in its
published settings (cells of 0.1 m, d_s 0.2 m, d_p 1) a ray ends in the first such cell of any ray,
and d_p cells behind it count as passed ("inflate_unknown_compensation").
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from numba import njit

import oddsmap

__all__ = ["dufomap", "grounds_and_outliers", "octomap", "octomap_gf"]

BoolArray = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_HIT, _MISS = np.log(0.7 / 0.3), np.log(0.4 / 0.6)
_LOWEST, _HIGHEST = np.log(0.12 / 0.88), np.log(0.97 / 0.03)


def points_of(scan: oddsmap.Scan) -> FloatArray:
    """The returns of a scan in the map frame [m]."""
    seen = np.isfinite(scan.ranges)
    return scan.map_from_sensor.transform(scan.directions[seen] * scan.ranges[seen, None])


def without(scan: oddsmap.Scan, gone: BoolArray) -> oddsmap.Scan:
    """A scan without some of its returns."""
    kept = np.isfinite(scan.ranges)
    kept[kept] = ~gone
    return oddsmap.Scan(
        scan.map_from_sensor, scan.directions[kept], scan.ranges[kept], trusted=True
    )


Masks = tuple[list[BoolArray], list[BoolArray]]
"""Ground points and outliers of each scan."""


def octomap(
    scans: Sequence[oddsmap.Scan], resolution: float, masks: Masks | None = None
) -> list[BoolArray]:
    """Dynamic points of each scan; of `masks` the ground clears alone, outliers do nothing."""
    clouds = [points_of(scan) for scan in scans]
    all_points = np.concatenate(clouds)
    cells, which = np.unique(
        np.floor(all_points / resolution).astype(np.int64), axis=0, return_inverse=True
    )
    odds = np.zeros(len(cells))
    for k, scan in enumerate(scans):
        if masks is None:
            hits, passes = oddsmap.build_map([scan], resolution).tiles.at(cells)
        else:
            ground, outlier = masks[0][k], masks[1][k]
            marks = oddsmap.build_map([without(scan, ground | outlier)], resolution)
            clears = oddsmap.build_map([without(scan, outlier)], resolution)
            hits, _ = marks.tiles.at(cells)
            # A cell of the ground is neither met nor passed.
            passes = clears.tiles.at(cells)[1]
        change = np.where(hits > 0, _HIT, np.where(passes > 0, _MISS, 0.0))
        odds = np.where(change != 0.0, np.clip(odds + change, _LOWEST, _HIGHEST), odds)
    dynamic = (odds <= 0.0)[which.ravel()]
    return np.split(dynamic, np.cumsum([len(cloud) for cloud in clouds])[:-1])


def octomap_gf(scans: Sequence[oddsmap.Scan], resolution: float, masks: Masks) -> list[BoolArray]:
    """As `octomap`, with the ground kept and outliers not mapped."""
    dynamic = octomap(scans, resolution, masks)
    return [gone & ~ground for gone, ground in zip(dynamic, masks[0], strict=True)]


def grounds_and_outliers(scans: Sequence[oddsmap.Scan]) -> Masks:
    """What `octomap_gf` takes apart: a scan alone says it, wherever it was taken."""
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(0)
    grounds, outliers = [], []
    for scan in scans:
        points = points_of(scan)
        distance, _ = cKDTree(points).query(points, k=51)
        mean = distance[:, 1:].mean(axis=1)
        outlier = mean > mean.mean() + mean.std()
        outliers.append(outlier)
        grounds.append(_level_plane(points, rng))
    return grounds, outliers


def _level_plane(points: FloatArray, rng: np.random.Generator) -> BoolArray:
    """The points within 4 cm of the level plane that has the most: RANSAC."""
    best = np.zeros(len(points), np.bool_)
    for _ in range(100):
        a, b, c = points[rng.integers(len(points), size=3)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length == 0.0 or abs(normal[2]) / length < np.cos(0.15):
            continue
        near = np.abs((points - a) @ (normal / length)) <= 0.04
        if near.sum() > best.sum():
            best = near
    return best


def dufomap(
    scans: Sequence[oddsmap.Scan], resolution: float, *, d_s: float = 0.2, d_p: int = 1
) -> list[BoolArray]:
    """Dynamic points of each scan."""
    clouds = [points_of(scan) for scan in scans]
    all_points = np.concatenate(clouds)
    cells, which = np.unique(
        np.floor(all_points / resolution).astype(np.int64), axis=0, return_inverse=True
    )
    void = np.zeros(len(cells), np.bool_)
    room = 2 * d_p + 2
    for scan, cloud in zip(scans, clouds, strict=True):
        start = np.asarray(scan.map_from_sensor.translation)
        ends = np.vstack([cloud, start]) / resolution
        lo = np.floor(ends.min(axis=0)).astype(np.int64) - room
        field = np.zeros(np.floor(ends.max(axis=0)).astype(np.int64) + room + 1 - lo, np.uint8)
        way = cloud - start
        way /= np.linalg.norm(way, axis=1)[:, None]
        for back in np.arange(0.0, d_s + 1e-9, resolution / 4):
            near = np.floor((cloud - way * back) / resolution).astype(np.int64) - lo
            field[tuple(near.T)] = _MET
        _pass(field, start / resolution - lo, cloud / resolution - lo, d_p)
        inside = (cells >= lo + room) & (cells < lo + np.array(field.shape) - room)
        asked = np.flatnonzero(inside.all(axis=1) & ~void)
        void[asked] = _void(field, cells[asked] - lo, d_p)
    dynamic = void[which.ravel()]
    return np.split(dynamic, np.cumsum([len(cloud) for cloud in clouds])[:-1])


# What a scan says of a cell; 0: nothing.
_PASSED, _MET = 1, 2


@njit()
def _pass(field: npt.NDArray[np.uint8], start: FloatArray, ends: FloatArray, d_p: int) -> None:
    """Mark the cells that rays pass, until one is met, and d_p cells behind it."""
    at, step = np.empty(3, np.int64), np.empty(3, np.int64)
    due, gap = np.empty(3), np.empty(3)
    for i in range(len(ends)):
        for k in range(3):
            way = ends[i, k] - start[k]
            at[k] = int(np.floor(start[k]))
            step[k] = 1 if way > 0.0 else -1
            gap[k] = abs(1.0 / way) if way != 0.0 else np.inf
            border = at[k] + (1 if way > 0.0 else 0)
            due[k] = (border - start[k]) / way if way != 0.0 else np.inf
        left = -1
        while left != 0:
            x, y, z = at
            if left < 0 and field[x, y, z] == _MET:
                left = d_p + 1
            if field[x, y, z] == 0:
                field[x, y, z] = _PASSED
            axis = 0 if due[0] <= due[1] and due[0] <= due[2] else (1 if due[1] <= due[2] else 2)
            if due[axis] > 1.0 and left < 0:
                left = d_p + 1
            at[axis] += step[axis]
            due[axis] += gap[axis]
            left = left - 1 if left > 0 else left


@njit()
def _void(field: npt.NDArray[np.uint8], cells: IntArray, d_p: int) -> BoolArray:
    """Which cells were passed and not met, with no unknown cell around them."""
    void = np.zeros(len(cells), np.bool_)
    for i in range(len(cells)):
        x, y, z = cells[i]
        if field[x, y, z] == _PASSED:
            around = field[x - d_p : x + d_p + 1, y - d_p : y + d_p + 1, z - d_p : z + d_p + 1]
            void[i] = around.min() > 0
    return void
