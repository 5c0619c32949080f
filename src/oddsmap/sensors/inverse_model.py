# SPDX-License-Identifier: Apache-2.0
"""The inverse sensor model p(x | z) of a narrow beam, as weights of hits and passes along it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from oddsmap.array_types import FloatArray

if TYPE_CHECKING:
    from oddsmap.sensors.beam import BeamSensor

__all__ = ["beam_weights"]


def beam_weights(
    sensor: BeamSensor, at: FloatArray, reading: float, cell: float
) -> tuple[FloatArray, FloatArray]:
    """What cells centred at `at` get of a reading: hits and passes, each of `at`'s shape."""
    near, far = max(reading - sensor.half_width, 0.0), reading + sensor.half_width
    if cell == 0.0:
        fading = (near - at) / sensor.fade if sensor.fade > 0.0 else np.inf
        passes = np.where(at < near, np.minimum(fading, 1.0), 0.0)
        return np.where((near <= at) & (at <= far), 1.0, 0.0), passes
    start, stop = at - cell / 2, at + cell / 2
    mass = _mass_until(sensor, stop, reading) - _mass_until(sensor, start, reading)
    shared = sensor.sigma > 0.0 or sensor.share_hit or sensor.half_width == 0.0
    hits = mass if shared else np.where(mass > 0.0, 1.0, 0.0)
    start, way = np.maximum(start, 0.0), stop - np.maximum(start, 0.0)
    weighed = _pass_until(sensor, near - start) - _pass_until(sensor, near - stop)
    free = (stop <= near) & (way > 0.0)  # the cell where the free part ends gets no pass
    return hits, np.divide(weighed, way, out=np.zeros_like(at), where=free)


def _mass_until(sensor: BeamSensor, at: FloatArray, reading: float) -> FloatArray:
    """Share of a shared hit that lies before a distance."""
    near, far = max(reading - sensor.half_width, 0.0), reading + sensor.half_width
    if sensor.half_width == 0.0:
        return np.where(at > reading, 1.0, 0.0)
    inside = np.clip(at, near, far)
    if sensor.sigma == 0.0:
        return np.asarray((inside - near) / (far - near))
    unit = 1.0 / (math.sqrt(2.0) * sensor.sigma)
    low, high = math.erf((near - reading) * unit), math.erf(sensor.half_width * unit)
    erf = np.vectorize(math.erf, otypes=[np.float64])
    return np.asarray((erf((inside - reading) * unit) - low) / (high - low))


def _pass_until(sensor: BeamSensor, way: FloatArray) -> FloatArray:
    """Integral of a pass's weight over the last part of the free way."""
    if sensor.fade == 0.0:
        return way
    return np.where(way < sensor.fade, way**2 / (2.0 * sensor.fade), way - sensor.fade / 2)
