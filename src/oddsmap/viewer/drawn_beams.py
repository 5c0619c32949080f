# SPDX-License-Identifier: Apache-2.0
"""The beams of a scan as they are drawn: where each starts and ends, and whether it came back."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.scan import Scan
from oddsmap.sensors.registry import Sensor
from oddsmap.sensors.usable_beams import judge_readings
from oddsmap.witnesses.reach import rays_of

__all__ = ["DrawnBeams", "Reach", "beams_of", "reach_of"]

_NO_LIMITS = (0.0, math.inf, math.nan, math.nan)


class DrawnBeams(NamedTuple):
    """Some beams of a scan, in the map frame."""

    starts: FloatArray
    """Where they start [m], shape (k, d)."""
    ends: FloatArray
    """Where they end [m], shape (k, d)."""
    returned: BoolArray
    """Whether something was seen there, shape (k,)."""
    readings: int
    """How many the whole scan has."""
    silent: int
    """How many of these say nothing, and are never drawn."""

    @property
    def size(self) -> int:
        """How many are drawn."""
        return len(self.returned)


class Reach(NamedTuple):
    """How far beams are drawn, arrays of shape (k,)."""

    length: FloatArray
    """From the start to the end [m]; NaN where a reading says nothing."""
    returned: BoolArray
    """Whether something was seen at the end."""


def reach_of(ranges: FloatArray, sensor: Sensor | None) -> Reach:
    """How far beams are drawn: to what they saw, and without a return as far as they may have seen.

    That is the range at which readings end, or else the reading itself. An infinite one, of a
    sensor whose range nobody knows, ends with the farthest return.

    Args:
        ranges: readings [m], shape (n,).
        sensor: says which of them are returns.
    """
    limits = getattr(sensor, "limits", getattr(sensor, "forward_limits", _NO_LIMITS))
    verdicts = judge_readings(ranges, limits)
    length = np.where(verdicts.seen, ranges, verdicts.reach)
    silent = np.isnan(ranges) | (ranges < limits[0]) | (ranges == 0.0)
    # A no-return that clears nothing has no reach there; a forward model's is infinite.
    open_end = ~silent & ~verdicts.seen & ~np.isfinite(length)
    last = limits[1]
    if not math.isfinite(last):
        last = float(ranges[verdicts.seen].max(initial=0.0))
    length[open_end] = np.where(np.isfinite(ranges[open_end]), ranges[open_end], last)
    length[silent] = np.nan
    return Reach(length, verdicts.seen)


def beams_of(scan: Measurement, sensor: Sensor | None, most: int) -> DrawnBeams:
    """The beams of a scan that are drawn, evenly chosen among those that say something.

    Args:
        scan: any measurement; one that sees cells has no beams.
        sensor: its model.
        most: how many at most. Where a scan has rows of as many beams, a prime number is better:
            then no column of them is left out.
    """
    d = len(scan.map_from_sensor.translation)
    if isinstance(scan, DepthScan):
        scan = scan.to_scan()
    if not isinstance(scan, Scan):
        return DrawnBeams(np.empty((0, d)), np.empty((0, d)), np.empty(0, np.bool_), 0, 0)
    reach = reach_of(scan.ranges, sensor)
    speaks = np.flatnonzero(np.isfinite(reach.length))
    silent = scan.size - len(speaks)
    if not scan.map_from_sensor.is_finite:
        speaks = speaks[:0]
    chosen = _evenly(speaks, most)
    starts, directions = rays_of(scan, chosen)
    ends = starts + directions * reach.length[chosen, None]
    return DrawnBeams(starts, ends, reach.returned[chosen], scan.size, silent)


def _evenly(numbers: IntArray, most: int) -> IntArray:
    if len(numbers) <= most:
        return numbers
    return numbers[np.arange(most) * len(numbers) // most]
