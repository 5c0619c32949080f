# SPDX-License-Identifier: Apache-2.0
"""How well a map of some scans predicts others: what decides between readings of a log.

Scans that see one place are split in two. A map is made of one half; of each beam of the other half
its end and some places before it are looked up. Where the map calls cells occupied that beams end
in, and free those that beams pass, it knows something of these beams: the mutual information of
what the map says of a place (nothing, free, in conflict, occupied) and what the beam does there. A
wrong pose, unit or time makes the two independent.

Source: Cover, Thomas: Elements of Information Theory (2006), section 2.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.evidence.lookup import floor_cells, units_at
from oddsmap.evidence_map import EvidenceMap
from oddsmap.integrate.add import add_scans
from oddsmap.poses.pose import Pose, Pose3
from oddsmap.scans.scan import Scan

__all__ = ["Placed", "information"]

# Places looked up on each beam before its end.
_PLACES = 8
# They end this many cells before the end of the beam, whose own cell is occupied.
_BEFORE_END = 1.5
# Fractions of a beam, spread evenly however many there are: multiples of the golden ratio.
_STEP = 0.6180339887498949
# A scan whose sensor is this many cells from the first one sees nothing that is mapped.
_FAR = 2000.0


class Placed(NamedTuple):
    """A scan where a reading of its log puts it."""

    pose: Pose
    """map_from_sensor."""
    points: FloatArray
    """Ends of its beams in the sensor frame [m], shape (n, d)."""


def information(scans: Sequence[Placed], side: float) -> float:
    """What maps of every other scan say of the beams of those between [nats per beam].

    Args:
        scans: two or more that see one place, with poses near the origin.
        side: of the cells [m].

    Returns:
        The mutual information; 0 where the maps say nothing.
    """
    counts = np.zeros((2, 4))
    for half in (0, 1):
        near = [
            scan
            for scan in scans[half::2]
            if float(np.abs(scan.pose.translation).max()) < _FAR * side
        ]
        known = EvidenceMap(side, ndim=scans[0].points.shape[1])
        add_scans(known, [_scan_of(scan) for scan in near])
        for scan in scans[1 - half :: 2]:
            _count(known, scan, counts)
    return _mutual(counts) * (1 + _PLACES)


def _scan_of(scan: Placed) -> Scan:
    if isinstance(scan.pose, Pose3):
        return Scan.from_points(scan.pose, scan.points)
    ranges = np.hypot(scan.points[:, 0], scan.points[:, 1])
    seen = ranges > 0.0
    return Scan(scan.pose, scan.points[seen] / ranges[seen, None], ranges[seen], trusted=True)


def _count(known: EvidenceMap, scan: Placed, counts: FloatArray) -> None:
    """Count what a map says of the ends of beams (row 1) and of places before them (row 0)."""
    n, d = scan.points.shape
    side = known.resolution
    if float(np.abs(scan.pose.translation).max()) >= _FAR * side:
        counts[:, 0] += n * _PLACES, n
        return
    ranges = np.sqrt((scan.points**2).sum(axis=1))
    free = np.maximum(0.0, 1.0 - _BEFORE_END * side / np.maximum(ranges, 1e-9))
    way = np.minimum(np.modf(np.arange(n * _PLACES) * _STEP)[0].reshape(n, -1), free[:, None])
    before = (scan.points[:, None, :] * way[..., None]).reshape(-1, d)
    for row, points in enumerate((before, scan.points)):
        cells = floor_cells(scan.pose.transform(points) / side)
        counts[row] += np.bincount(_states(*units_at(known, cells)), minlength=4)


def _states(hits: IntArray, passes: IntArray) -> npt.NDArray[np.intp]:
    """0: never seen, 1: only passed, 2: passed more often than hit, 3: hit as often or more."""
    state = np.where(hits == 0, 1, np.where(hits < passes, 2, 3))
    return np.where(hits + passes == 0, 0, state)


def _mutual(counts: FloatArray) -> float:
    joint = counts / max(float(counts.sum()), 1.0)
    apart = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0, keepdims=True)
    some = joint > 0.0
    return float((joint[some] * np.log(joint[some] / apart[some])).sum())
