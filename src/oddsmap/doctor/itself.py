# SPDX-License-Identifier: Apache-2.0
"""Whether a sensor sees the robot that carries it: returns that stay where they are on it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.doctor.examined import Examined
from oddsmap.plausibility.sample import Glance
from oddsmap.poses.pose import Pose3
from oddsmap.scans.note import Note

__all__ = ["doubts_of_itself"]

# A robot reaches no further from its sensor [m], and stays in one cell of this side [m].
_REACH, _CELL = 1.5, 0.1
# In so many scans, and this share of them, taken this far apart [m]: further than the room around a
# sensor looks the same.
_SCANS, _SHARE, _APART = 8, 0.75, 1.0
# What is said of the box that leaves them out is this much larger than they are [m].
_MARGIN = 0.02
# The floor, with a carpet on it, is within this of the lowest returns [m].
_FLOOR = 0.15


def doubts_of_itself(seen: Examined) -> list[Note]:
    """Name the box of returns that the sensor has of its own robot."""
    scans = _apart([glance for group in seen.groups for glance in group])
    if len(scans) < _SCANS:
        return []
    count: Counter[tuple[int, ...]] = Counter()
    for glance in scans:
        cells = np.unique(np.floor(_near(glance) / _CELL).astype(np.int64), axis=0)
        count.update(map(tuple, cells.tolist()))
    own = {cell for cell, n in count.items() if n >= _SHARE * len(scans)}
    if not own:
        return []
    near = np.concatenate([_near(glance) for glance in scans])
    cells = np.floor(near / _CELL).astype(np.int64).tolist()
    points = near[[tuple(cell) in own for cell in cells]]
    low, high = points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
    box = [",".join(f"{value:.2f}" for value in corner) for corner in (low, high)]
    text = (
        f"returns at {np.sqrt((points**2).sum(axis=1)).min():.2f} m and more stay where they are "
        f"on the sensor in {max(count[c] for c in own)} of {len(scans)} scans at different "
        f"places: it sees its own robot; --set sensor.body_min=[{box[0]}] "
        f"--set sensor.body_max=[{box[1]}] keeps them from marking"
    )
    return [Note(text, code="range.own_body", severity="warning")]


def _apart(glances: Sequence[Glance]) -> list[Glance]:
    """Scans each taken some way from the one before."""
    chosen: list[Glance] = []
    for glance in glances:
        at = glance.pose.translation
        if not chosen or np.linalg.norm(at - chosen[-1].pose.translation) > _APART:
            chosen.append(glance)
    return chosen


def _near(glance: Glance) -> FloatArray:
    """Returns that may be the robot's: not those of the floor, which stays where it is as well."""
    square = (glance.points**2).sum(axis=1)
    near = square < _REACH**2
    if isinstance(glance.pose, Pose3) and near.any():
        height = glance.points @ glance.pose.rotation[2]
        near &= height > np.quantile(height[square < (3 * _REACH) ** 2], 0.02) + _FLOOR
    found: FloatArray = glance.points[near]
    return found
