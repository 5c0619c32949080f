# SPDX-License-Identifier: Apache-2.0
"""Two maps that look around a cell, written plainly to compare with: kernels and Hilbert maps.

Part of `neighbours.py`. Both learn from points: where beams ended, and places along them.

- Bayesian generalised kernels as la3dm has them: a cell's hits and passes are the sums of a sparse
  kernel over the points, each counted by its distance from the cell's centre, beside a prior's.
- Hilbert maps: logistic regression on the same kernel about points of a lattice, learnt by
  stochastic gradient descent.

Source: Doherty, Shan, Wang, Englot, Learning-aided 3-D occupancy mapping with Bayesian generalized
kernel inference (2019); Ramos, Ott, Hilbert maps (2016); Melkumyan, Ramos (2009) for the kernel.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

from oddsmap import Scan

__all__ = ["Box", "hilbert", "kernel", "kernel_sums", "points"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
_Function = TypeVar("_Function", bound=Callable[..., Any])


def _compiled(function: _Function) -> _Function:
    return cast(_Function, numba.njit(function))


@dataclass(frozen=True)
class Box:
    """Cells from `lo` on, `shape` of them along x, y (and z), of `side` [m]."""

    lo: IntArray
    shape: IntArray
    side: float

    def flat(self, index: IntArray) -> IntArray:
        """Places of cells in arrays of the box."""
        return np.asarray(np.ravel_multi_index(tuple((index - self.lo).T), tuple(self.shape)))


def points(
    scans: Iterable[Scan], step: float, leaf: float, range_max: float
) -> tuple[FloatArray, FloatArray]:
    """Points of scans, shape (n, d), and 1 where something is, 0 where nothing is, as la3dm.

    Args:
        scans: beams without a return are left out.
        step: distance between the free points along a beam [m]; one is the sensor's place, and
            one lies a step before the end.
        leaf: of the points of a scan that lie in one voxel of this size the mean is taken [m].
        range_max: readings from here on are no returns [m].
    """
    found: list[tuple[FloatArray, float]] = []
    for scan in scans:
        pose, z = scan.map_from_sensor, np.asarray(scan.ranges)
        valid = (z > 0.0) & (z < range_max)
        if not valid.any():
            continue
        origin = np.asarray(pose.translation)
        ends = _thinned(origin + (scan.directions[valid] * z[valid, None]) @ pose.rotation.T, leaf)
        found.append((ends, 1.0))
        beams = ends - origin
        length = np.linalg.norm(beams, axis=1)
        along = np.arange(0.0, length.max(), step)
        beam, which = np.nonzero(along < length[:, None])
        at = np.append(along[which], length[length > step] - step)
        beam = np.append(beam, np.flatnonzero(length > step))
        free = origin + beams[beam] * (at / length[beam])[:, None]
        found.append((_thinned(free, leaf), 0.0))
    x = np.concatenate([some for some, _ in found])
    return x, np.concatenate([np.full(len(some), y) for some, y in found])


def _thinned(x: FloatArray, leaf: float) -> FloatArray:
    voxel = np.floor(x / leaf).astype(np.int64)
    voxel -= voxel.min(axis=0)
    key = np.ravel_multi_index(tuple(voxel.T), tuple(voxel.max(axis=0) + 1))
    _, which, count = np.unique(key, return_inverse=True, return_counts=True)
    return np.stack([np.bincount(which, axis) for axis in x.T], axis=1) / count[:, None]


@_compiled
def kernel(d: float) -> float:
    """The sparse kernel at a distance, as a share of the length from which on it is 0."""
    if d >= 1.0:
        return 0.0
    turn = 2.0 * math.pi * d
    return (2.0 + math.cos(turn)) / 3.0 * (1.0 - d) + math.sin(turn) / (2.0 * math.pi)


def kernel_sums(
    x: FloatArray, y: FloatArray, length: float, box: Box
) -> tuple[FloatArray, FloatArray]:
    """What is said of each cell of a box: kernel sums over points of 1, and of 0."""
    reach = math.ceil(length / box.side)
    steps = _steps(reach, len(box.lo))
    out = np.zeros((2, int(box.shape.prod())))
    _add_sums(x / box.side - box.lo, y, length / box.side, steps, box.shape, out)
    return out[1], out[0]


@_compiled
def _add_sums(
    x: FloatArray, y: FloatArray, length: float, steps: IntArray, shape: IntArray, out: FloatArray
) -> None:
    cell, off = np.empty(len(shape), np.int64), np.empty(len(shape))
    for n in range(len(x)):
        for axis in range(len(shape)):
            cell[axis] = math.floor(x[n, axis])
            off[axis] = cell[axis] + 0.5 - x[n, axis]
        for step in steps:
            square, flat, inside = 0.0, 0, True
            for axis in range(len(shape)):
                place = cell[axis] + step[axis]
                inside = inside and 0 <= place < shape[axis]
                flat = flat * shape[axis] + place
                square += (off[axis] + step[axis]) ** 2
            if inside and square < length * length:
                out[int(y[n]), flat] += kernel(math.sqrt(square) / length)


def hilbert(
    x: FloatArray,
    y: FloatArray,
    cells: FloatArray,
    length: float,
    *,
    rate: float = 0.5,
    epochs: int = 3,
    decay: float = 1e-4,
) -> FloatArray:
    """Log odds of places, of a Hilbert map of points; lattice points are half a length apart.

    Args:
        x: points, see `points`.
        y: what they are, likewise.
        cells: the places asked for [m], shape (m, d).
        length: of the kernel [m].
        rate: of the first epoch; divided by the number of each.
        epochs: how often all points are taken, in a random order.
        decay: of the weights of a point's features, each time it is taken.
    """
    low = np.minimum(x.min(axis=0), cells.min(axis=0)) - length
    shape = (
        np.ceil((np.maximum(x.max(axis=0), cells.max(axis=0)) - low) / length * 2).astype(np.int64)
        + 3
    )
    weights, bias, steps = np.zeros(int(shape.prod())), np.zeros(1), _steps(2, x.shape[1])
    rng = np.random.default_rng(1)
    at = (x - low) / length * 2.0
    for epoch in range(1, epochs + 1):
        _descend(at, y, rng.permutation(len(x)), steps, shape, rate / epoch, decay, weights, bias)
    out = np.empty(len(cells))
    _predict((cells - low) / length * 2.0, steps, shape, weights, bias[0], out)
    return out


@_compiled
def _features(
    x: FloatArray, steps: IntArray, shape: IntArray, which: IntArray, value: FloatArray
) -> int:
    count = 0
    for step in steps:
        square, flat = 0.0, 0
        for axis in range(len(shape)):
            node = round(x[axis]) + step[axis]
            flat = flat * shape[axis] + node
            square += (node - x[axis]) ** 2
        if square < 4.0:
            which[count], value[count] = flat, kernel(math.sqrt(square) / 2.0)
            count += 1
    return count


@_compiled
def _descend(
    x: FloatArray, y: FloatArray, order: IntArray, steps: IntArray, shape: IntArray,
    rate: float, decay: float, weights: FloatArray, bias: FloatArray,
) -> None:  # fmt: skip
    which, value = np.empty(len(steps), np.int64), np.empty(len(steps))
    for n in order:
        count = _features(x[n], steps, shape, which, value)
        total = bias[0]
        for k in range(count):
            total += weights[which[k]] * value[k]
        off = y[n] - 1.0 / (1.0 + math.exp(-total))
        bias[0] += rate * off * 0.01  # slow, for every point moves it
        for k in range(count):
            weights[which[k]] += rate * (off * value[k] - decay * weights[which[k]])


@_compiled
def _predict(
    x: FloatArray, steps: IntArray, shape: IntArray, weights: FloatArray, bias: float,
    out: FloatArray,
) -> None:  # fmt: skip
    which, value = np.empty(len(steps), np.int64), np.empty(len(steps))
    for n in range(len(x)):
        out[n] = bias
        for k in range(_features(x[n], steps, shape, which, value)):
            out[n] += weights[which[k]] * value[k]


def _steps(reach: int, ndim: int) -> IntArray:
    return np.array(list(itertools.product(range(-reach, reach + 1), repeat=ndim)))
