# SPDX-License-Identifier: Apache-2.0
"""Whether readings without a return were written as a number below range_max, or with noise.

Simulators and some drivers put noise on the number that stands for "nothing seen": part of these
readings fall below range_max, look like returns, and become a ring of walls around the robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.plausibility.sample import Glance
from oddsmap.scans.note import Note

__all__ = ["doubts_of_no_returns"]

# Of all returns at least this share lies in the spike. In the one recording with such readings it
# is .37 and .66; of the sound ones only simulated clouds have a spike at all, of .045.
_SHARE = 0.06
# How many times as dense as right below it. Measured: 450 and 890; sound logs reach 1.5.
_RATIO = 10.0
# How wide it may be, as shares of the longest range: the first that fits.
_WIDTHS = (0.0025, 0.005, 0.01, 0.02, 0.04)
# Too few returns, or nothing nearer than the spike, say nothing about what is usual.
_MIN_RETURNS = 1000
_MIN_BELOW = 0.05
# No sensor ranges farther [m]: what is above is no number to take shares of.
_ENDLESS = 1e6
# Bins of the walk down from the top, as shares of the longest range.
_BIN = 0.0025


def doubts_of_no_returns(glances: Sequence[Glance], range_max: float) -> list[Note]:
    """Doubt returns that pile up at the end of the range, wherever the sensor was.

    Args:
        glances: scans that were looked at.
        range_max: a reading from here on is no return [m].
    """
    scans = [np.linalg.norm(glance.points, axis=1) for glance in glances if not glance.from_image]
    scans = [ranges[ranges < min(range_max, _ENDLESS)] for ranges in scans]
    ranges = np.concatenate([np.empty(0), *scans])
    if len(ranges) < _MIN_RETURNS:
        return []
    top = float(ranges.max())
    for width in _WIDTHS:
        start = top * (1.0 - width)
        spike = ranges[ranges >= start]
        below = np.count_nonzero((ranges >= top * (1.0 - 3.0 * width)) & (ranges < start)) / 2
        seen_by = np.mean([bool((scan >= start).any()) for scan in scans if len(scan)])
        if (
            len(spike) >= max(_SHARE * len(ranges), _RATIO * max(below, 1.0))
            and len(ranges) - len(spike) >= _MIN_BELOW * len(ranges)
            and seen_by > 0.5
        ):
            return [_doubt(ranges, top)]
    return []


def _doubt(ranges: FloatArray, top: float) -> Note:
    limit = _foot(ranges, top)
    share = float(np.mean(ranges >= limit))
    text = (
        f"{share:.0%} of the returns lie within {top - limit:.2g} m of the longest, {top:.4g} m, "
        "and hardly any right below: are they no-returns, with noise on them? They make a false "
        f"ring of walls; --set sensor.range_max={limit:g} takes them as no returns"
    )
    return Note(text, code="range.smeared_no_returns", severity="warning")


def _foot(ranges: FloatArray, top: float) -> float:
    """Where the spike begins, a little below [m]: walked down to while it is denser than usual."""
    counts, edges = np.histogram(ranges, bins=round(0.2 / _BIN), range=(0.8 * top, top))
    usual = float(np.median(counts))
    at = len(counts)
    while at > 1 and counts[at - 1] > 2.0 * usual + 5.0:
        at -= 1
    # Another bin for the tail, and two digits after the first: a number to type.
    digits = 2 - math.floor(math.log10(top))
    scale = 10.0**digits
    return float(round(math.floor(edges[at - 1] * scale) / scale, max(digits, 0)))
