"""Sorting readings, one NumPy step a rule: the readable version of kernels/trace/clip_beams.py."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor

FloatArray = npt.NDArray[np.float64]


def reach(
    sensor: BeamSensor, ranges: FloatArray
) -> tuple[FloatArray, npt.NDArray[np.bool_], Counter[str]]:
    """How far each beam says something [m], NaN where it does not; whether it hit; the skipped."""
    unseen = ranges == np.inf
    over = (ranges >= (sensor.range_max or math.inf)) & ~unseen
    below = ranges < sensor.range_min
    zero = (ranges == 0) & ~below
    far = ranges.copy()
    far[below | zero] = np.nan
    clear_unseen = sensor.range_max if sensor.clear_range is None else sensor.clear_range
    far[unseen] = np.nan if clear_unseen is None else clear_unseen
    far[over] = np.nan if sensor.clear_range is None else sensor.clear_range
    skipped = Counter(
        {
            "beam.nan": int(np.isnan(ranges).sum()),
            "beam.below_range_min": int(below.sum()),
            "beam.zero_range": int(zero.sum()),
            "beam.no_return": int(((unseen | over) & np.isnan(far)).sum()),
        }
    )
    return far, ~(unseen | over), +skipped


def vector(scan: Scan, i: int) -> tuple[FloatArray, float]:
    """A vector along beam i in the map frame, and its length [m]: its point where it has one."""
    along, length = scan.directions[i], 1.0
    if scan.measured_points is not None:
        along, length = scan.measured_points[i], float(scan.ranges[i])
    rotation = scan.map_from_sensor.rotation
    ray = np.zeros(len(along))
    for column in range(len(along)):
        ray += rotation[:, column] * along[column]
    return ray, length


def segments(
    sensor: BeamSensor, scans: Sequence[Scan]
) -> list[tuple[FloatArray, FloatArray, bool]]:
    """(end of the free part, end of the occupied part, hit?) of each usable beam, metres."""
    found = []
    for scan in scans:
        if not scan.map_from_sensor.is_finite:
            continue
        far, hit, _ = reach(sensor, scan.ranges)
        for i in np.flatnonzero(~np.isnan(far)):
            half = sensor.half_width if hit[i] else 0.0
            origin = scan.map_from_sensor.translation
            ray, length = vector(scan, int(i))
            end = origin + ray * (max(far[i] - half, 0.0) / length)
            tip = origin + ray * ((far[i] + half) / length) if sensor.half_width > 0 else end
            found.append((end, tip, bool(hit[i])))
    return found


def fades(sensor: BeamSensor, scans: Sequence[Scan]) -> list[FloatArray]:
    """Where the passes of each usable beam begin to fade, metres: by a sensor that sees shorter."""
    found = []
    for scan in scans:
        if not scan.map_from_sensor.is_finite:
            continue
        far, hit, _ = reach(sensor, scan.ranges)
        for i in np.flatnonzero(~np.isnan(far)):
            origin = scan.map_from_sensor.translation
            ray, length = vector(scan, int(i))
            near = (max(far[i] - sensor.half_width, 0.0) if hit[i] else far[i]) / length
            begin = max(near - sensor.fade / length, 0.0) if hit[i] else near
            found.append(origin + ray * begin)
    return found
