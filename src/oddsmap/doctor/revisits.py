# SPDX-License-Identifier: Apache-2.0
"""Whether walls stand where they stood when the robot comes back: odometry doubles them.

Scans of two times that were taken close together are laid over each other by iterated closest
points. What that moves them by is the error of their poses against each other.

Source: Besl, McKay: A method for registration of 3-D shapes, PAMI 14 (1992); Umeyama:
Least-squares estimation of transformation parameters, PAMI 13 (1991).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.doctor.examined import Examined
from oddsmap.plausibility.sample import Glance
from oddsmap.scans.note import Note

__all__ = ["Revisit", "doubts_of_revisits", "find_revisits"]

# A place is visited again from within so many typical ranges, after having been left by as many.
_NEAR, _LEFT = 0.3, 0.6
# At most so many pairs are looked at, with so many points each.
_PAIRS, _POINTS, _REFERENCE = 32, 200, 800
# Scans of one visit are so many before and after another.
_BESIDE = 2
# How far closest points may be apart while scans are moved, in typical ranges, step by step.
_GATES = (0.25, 0.25, 0.18, 0.18, 0.12, 0.12, 0.07, 0.05)
# What lies on each other is this close in typical ranges, and scans fit with this share of points.
_FITS, _FITTING = 0.015, 0.5
# Poses are doubted where so many scans share less than this with those of another time, in relation
# to what they share with those of their own, ...
_FEWEST, _SHARED, _APART = 8, 0.05, 0.1
# ... or where so many that can be moved to fit are this far off, in typical ranges and metres.
_FEWEST_FITTING, _ERROR, _ERROR_M = 4, 0.05, 0.15


class Revisit(NamedTuple):
    """Scans of two times at one place."""

    error: float
    """How far their poses are wrong against each other [m]."""
    before: float
    """Share of the points that lay on those of the other time."""
    after: float
    """The same when they were moved."""
    usual: float
    """Share that lies on scans of the same time."""


def doubts_of_revisits(seen: Examined) -> list[Note]:
    """Doubt poses by which walls stand twice."""
    # A share says something where scans of one time share something.
    found = [each for each in find_revisits(seen) if each.usual > _SHARED]
    fitting = [each.error for each in found if each.after >= _FITTING]
    apart = len(found) >= _FEWEST and np.median([e.before / e.usual for e in found]) < _APART
    error = float(np.median(fitting)) if len(fitting) >= _FEWEST_FITTING else 0.0
    if not apart and error < max(_ERROR * seen.unit, _ERROR_M):
        return []
    off = f", {error:.2g} m off where both could be laid on each other" if error else ""
    text = (
        f"walls stand twice: at {len(found)} places to which the sensor came back, scans share "
        f"{np.median([e.before for e in found]):.0%} of their returns with those of the other time "
        f"in the middle, and {np.median([e.usual for e in found]):.0%} with others of their "
        f"own{off}. Are these poses raw odometry? Use those of a localisation or of SLAM"
    )
    return [Note(text, code="pose.drift", severity="warning")]


def find_revisits(seen: Examined) -> list[Revisit]:
    """Measure the places that were visited more than once."""
    unit = seen.unit
    if not unit > 0.0:
        return []
    way = [glance for glance in seen.waypoints if len(glance.points) > 20]
    pairs = _visited_again([glance.pose.translation for glance in way], unit)
    return [_compared(_around(way, i, unit), way[j], _around(way, j, unit), unit) for i, j in pairs]


def _around(way: Sequence[Glance], i: int, unit: float) -> list[Glance]:
    """A scan and those of the same visit before and after it."""
    at = way[i].pose.translation
    some = way[max(0, i - _BESIDE) : i + _BESIDE + 1]
    return [g for g in some if float(np.linalg.norm(g.pose.translation - at)) < _LEFT * unit]


def _visited_again(at: Sequence[FloatArray], unit: float) -> list[tuple[int, int]]:
    """Numbers of places that are near each other, and have been left between."""
    found = []
    for j in range(1, len(at)):
        apart = np.linalg.norm(np.array(at[:j]) - at[j], axis=1) / unit
        left = np.flatnonzero(apart > _LEFT)
        if len(left) and (before := apart[: left[-1]]).size and before.min() < _NEAR:
            found.append((float(before.min()), int(before.argmin()), j))
    return [(i, j) for _, i, j in sorted(found)[:_PAIRS]]


def _compared(
    first: Sequence[Glance], again: Glance, beside: Sequence[Glance], unit: float
) -> Revisit:
    reference = _thinned(np.concatenate([g.pose.transform(g.points) for g in first]), _REFERENCE)
    points = _thinned(again.pose.transform(again.points), _POINTS)
    others = [g.pose.transform(g.points) for g in beside if g is not again]
    usual = _share_on(points, np.concatenate(others), _FITS * unit) if others else np.nan
    sensor = again.pose.translation[None, :]
    before = _share_on(points, reference, _FITS * unit)
    moved, sensor_moved = points, sensor
    for gate in _GATES:
        distance, nearest = _closest(moved, reference)
        close = distance < gate * unit
        if close.sum() < 10:
            break
        rotation, centre, target = _rigid(moved[close], reference[nearest[close]])
        moved = (moved - centre) @ rotation.T + target
        sensor_moved = (sensor_moved - centre) @ rotation.T + target
    after = _share_on(moved, reference, _FITS * unit)
    # What is moved and fits no better was right.
    error = float(np.linalg.norm(sensor_moved - sensor)) if after > before else 0.0
    return Revisit(error, before, after, usual)


def _thinned(points: FloatArray, count: int) -> FloatArray:
    return points[:: max(1, len(points) // count)]


def _closest(points: FloatArray, reference: FloatArray) -> tuple[FloatArray, np.ndarray]:
    centre = reference.mean(axis=0)
    a, b = points - centre, reference - centre
    square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
    nearest = square.argmin(axis=1)
    return np.sqrt(np.maximum(square[np.arange(len(a)), nearest], 0.0)), nearest


def _share_on(points: FloatArray, reference: FloatArray, within: float) -> float:
    return float((_closest(points, reference)[0] < within).mean())


def _rigid(source: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rotation and centres of the rigid motion that takes points nearest to others."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((target - b).T @ (source - a))
    sign = np.ones(len(a))
    sign[-1] = np.sign(np.linalg.det(u @ vt))
    return (u * sign) @ vt, a, b
