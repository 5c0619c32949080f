# SPDX-License-Identifier: Apache-2.0
"""Whether neighbouring scans see the same world, and under which reading of their poses.

What two scans see of one wall must lie in one place of the map. How far apart it lies is measured
under the poses as they were read and under what else their numbers may have meant. A suspicion
needs many pairs of scans for it and next to none against it: on a good log each other reading
takes scans apart, so nothing is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.plausibility.pose_readings import AS_READ, PoseReading, readings_of
from oddsmap.plausibility.sample import Glance
from oddsmap.scans.note import Note

__all__ = ["Comparison", "compare_readings", "doubts_of_poses"]

Pair = tuple[Glance, Glance]

# Returns of the later scan that are looked for in the earlier one.
_QUERIES = 96
# A pair speaks for a reading that brings its scans together by this factor: by the second one where
# a scan has few returns, as of a ring of sonars, among which the nearest is some other wall's.
_CLEARLY, _CLEARLY_OF_FEW = 1.5, 10.0
_FEW_RETURNS, _FEWEST_RETURNS = 12, 3
# How many pairs must speak for a suspicion, and their share of those that speak at all and of those
# that can be compared.
_FEWEST_PAIRS = 5
_SHARE, _SHARE_OF_COMPARED = 0.85, 1 / 3
# Under the reading that was meant scans lie this close together, in ranges. In a log of scans far
# apart no motion at all may look better than a wrong one, but not as good as that.
_FITS = 0.2
# Two mistakes at once are less likely than one: they must fit better by this factor.
_MORE = 1.4
# Motion between two scans, in ranges: up to the first they overlap. From there to the second they
# may see different places, and then no motion at all would look better than the true one.
_OVERLAP, _NEVER = 0.4, 30.0
# A motion that is this much larger under one reading is one in another unit.
_OTHER_UNIT = 50.0


class Comparison(NamedTuple):
    """How one reading of the poses compares with how they were read."""

    reading: PoseReading
    pairs: int
    """Pairs of scans that could be compared."""
    better: int
    """Those that this reading brings together."""
    worse: int
    """Those that it takes apart."""
    closeness: float
    """How far apart the compared ones lie under this reading, relative to their ranges."""
    apart: float
    """How far apart scans lie as read, relative to their ranges: the median of all pairs."""
    apart_then: float
    """The same under this reading."""

    @property
    def is_suspicious(self) -> bool:
        """Whether this reading fits clearly better."""
        return (
            self.better >= _FEWEST_PAIRS
            and self.better >= _SHARE * (self.better + self.worse)
            and self.better >= _SHARE_OF_COMPARED * self.pairs
            and self.closeness <= _FITS
            and not self.apart_then > 1.0
        )


def doubts_of_poses(pairs: Sequence[Pair]) -> list[Note]:
    """Name the other reading of the poses that fits best, if one fits clearly better."""
    suspects = [found for found in compare_readings(pairs) if found.is_suspicious]
    if not suspects:
        return []
    best = min(suspects, key=lambda found: found.apart_then * _MORE**found.reading.mistakes)
    text = (
        f"are these {best.reading.suspicion}? {best.better} of {best.pairs} pairs of scans would "
        f"then fit together better and {best.worse} worse, with what both see "
        f"{_short(best.apart_then)} instead of {_short(best.apart)} ranges apart; if so, "
        f"{best.reading.remedy}"
    )
    return [Note(text, code=best.reading.code, severity="warning")]


def _short(number: float) -> str:
    return f"{number:.2g}" if number < 10.0 else f"{number:.0f}"


def compare_readings(pairs: Sequence[Pair]) -> list[Comparison]:
    """Compare all readings of the poses of some pairs of scans, of one dimension."""
    usable = [pair for pair in pairs if _returns(pair) >= _FEWEST_RETURNS]
    if not usable:
        return []
    as_read = [_Fit(pair, AS_READ) for pair in usable]
    # Few returns are too little to find two mistakes at once.
    most = 2 if np.median([_returns(pair) for pair in usable]) >= _FEW_RETURNS else 1
    readings = [reading for reading in readings_of(usable[0][0].ndim) if reading.mistakes <= most]
    return [_compare(reading, as_read) for reading in readings]


class _Fit:
    """How a pair of scans lies under one reading of their poses."""

    def __init__(self, pair: Pair, reading: PoseReading) -> None:
        earlier, later = pair
        a, b = reading.read(earlier.pose), reading.read(later.pose)
        self.pair = pair
        self._rotation = a.rotation.T @ b.rotation
        self._shift = a.rotation.T @ (b.translation - a.translation) * reading.scale
        self._apart: float | None = None
        self.motion = float(np.linalg.norm(self._shift)) / earlier.typical_range
        """How far the sensor moved, in typical ranges."""

    @property
    def apart(self) -> float:
        """How far apart what both see lies, in typical ranges; measured when asked for."""
        if self._apart is None:
            earlier, later = self.pair
            queries = later.points[:: max(1, len(later.points) // _QUERIES)]
            there = queries @ self._rotation.T + self._shift
            self._apart = _distance(there, earlier.points) / earlier.typical_range
        return self._apart


def _compare(reading: PoseReading, as_read: Sequence[_Fit]) -> Comparison:
    better = worse = compared = 0
    closeness = []
    for before in as_read:
        then = _Fit(before.pair, reading)
        if not _comparable(before.motion, then.motion):
            continue
        compared += 1
        factor = _CLEARLY if _returns(before.pair) >= _FEW_RETURNS else _CLEARLY_OF_FEW
        better += before.apart > factor * then.apart
        worse += then.apart > factor * before.apart
        closeness.append(then.apart)
        if worse >= _FEWEST_PAIRS and worse > better:
            break  # no suspicion any more: most readings of a good log end here
    close = float(np.median(closeness)) if closeness else np.nan
    found = Comparison(reading, compared, better, worse, close, np.nan, np.nan)
    if not found.is_suspicious:
        return found
    # Over all pairs, so that suspicions can be compared with each other.
    apart_then = np.median([_Fit(before.pair, reading).apart for before in as_read])
    apart = np.median([before.apart for before in as_read])
    return found._replace(apart=float(apart), apart_then=float(apart_then))


def _comparable(motion: float, motion_then: float) -> bool:
    near, far = sorted((motion, motion_then))
    return near <= _OVERLAP and not (far > _OTHER_UNIT * near and _OVERLAP < far < _NEVER)


def _returns(pair: Pair) -> int:
    return min(len(glance.points) for glance in pair)


def _distance(points: FloatArray, reference: FloatArray) -> float:
    """Mean distance of points from the nearest of a reference, without the farthest fifth."""
    square = (points**2).sum(axis=1)[:, None] + (reference**2).sum(axis=1)
    square -= 2.0 * points @ reference.T
    nearest = np.sort(np.sqrt(np.maximum(square.min(axis=1), 0.0)))
    return float(nearest[: max(1, len(nearest) * 4 // 5)].mean())
