# SPDX-License-Identifier: Apache-2.0
"""The inverse sensor model p(x | z) of a narrow beam, as weights of hits and passes along it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from oddsmap.array_types import FloatArray

__all__ = ["HitShape", "beam_weights"]


class HitShape(NamedTuple):
    """How a beam votes around its return; lengths in metres."""

    share: bool
    """True: the cells of the occupied region share one hit; False: each has a whole one."""
    half_width: float
    """How far that region reaches before and behind the return."""
    sigma: float
    """Above 0: the hit is shared by the mass of a normal distribution around the return."""
    fade: float
    """The way before that region over which passes fade."""


def beam_weights(
    shape: HitShape, at: FloatArray, reading: float, cell: float
) -> tuple[FloatArray, FloatArray]:
    """What cells centred at `at` get of a reading: hits and passes, each of `at`'s shape."""
    near, far = max(reading - shape.half_width, 0.0), reading + shape.half_width
    if cell == 0.0:
        fading = (near - at) / shape.fade if shape.fade > 0.0 else np.inf
        passes = np.where(at < near, np.minimum(fading, 1.0), 0.0)
        return np.where((near <= at) & (at <= far), 1.0, 0.0), passes
    start, stop = at - cell / 2, at + cell / 2
    mass = _mass_until(shape, stop, reading) - _mass_until(shape, start, reading)
    shared = shape.share or shape.half_width == 0.0
    hits = mass if shared else np.where(mass > 0.0, 1.0, 0.0)
    start, way = np.maximum(start, 0.0), stop - np.maximum(start, 0.0)
    weighed = _pass_until(shape, near - start) - _pass_until(shape, near - stop)
    free = (stop <= near) & (way > 0.0)  # the cell where the free part ends gets no pass
    return hits, np.divide(weighed, way, out=np.zeros_like(at), where=free)


def _mass_until(shape: HitShape, at: FloatArray, reading: float) -> FloatArray:
    """Share of a shared hit that lies before a distance."""
    near, far = max(reading - shape.half_width, 0.0), reading + shape.half_width
    if shape.half_width == 0.0:
        return np.where(at > reading, 1.0, 0.0)
    inside = np.clip(at, near, far)
    if shape.sigma == 0.0:
        return np.asarray((inside - near) / (far - near))
    unit = 1.0 / (math.sqrt(2.0) * shape.sigma)
    low, high = math.erf((near - reading) * unit), math.erf(shape.half_width * unit)
    erf = np.vectorize(math.erf, otypes=[np.float64])
    return np.asarray((erf((inside - reading) * unit) - low) / (high - low))


def _pass_until(shape: HitShape, way: FloatArray) -> FloatArray:
    """Integral of a pass's weight over the last part of the free way."""
    if shape.fade == 0.0:
        return way
    return np.where(way < shape.fade, way**2 / (2.0 * shape.fade), way - shape.fade / 2)
