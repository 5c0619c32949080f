# SPDX-License-Identifier: Apache-2.0
"""The way of the sensors of a log: a pose and a time for each scan, and some beams where asked.

Of a scan nothing else is kept, so that a log of any length is read through in little memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.poses.pose import Pose
from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.registry import Sensor
from oddsmap.viewer.drawn_beams import DrawnBeams, beams_of

__all__ = ["Journey", "kept_beams", "read_journey"]

# Of each scan in a file that holds the log, and of all scans together: of 3000 scans and more
# fewer are kept of each.
_MOST_OF_A_SCAN, _MOST_OF_ALL, _FEWEST = 101, 303_000, 11


@dataclass(frozen=True, slots=True, eq=False)
class Journey:
    """Where the sensors were, in the order of the log; n scans in d dimensions.

    Attributes:
        positions: of the sensor in the map frame [m], shape (n, d); NaN where a scan has no pose.
        yaw: where it looks [rad], counter-clockwise from the x axis of the map, shape (n,).
        pitch: likewise, upwards; 0 in the plane.
        stamps_ns: times [ns], shape (n,); 0 where there is none.
        stamped: whether a scan has a time, shape (n,).
        sensors: the ids of those that made the scans.
        whose: which of them made each, shape (n,).
        beams: some of each scan; empty where none were asked for.
    """

    positions: FloatArray
    yaw: FloatArray
    pitch: FloatArray
    stamps_ns: IntArray
    stamped: IntArray
    sensors: tuple[str, ...]
    whose: IntArray
    beams: tuple[DrawnBeams, ...]

    @property
    def scan_count(self) -> int:
        """How many scans the log has."""
        return len(self.positions)


def kept_beams(scan_count: int) -> int:
    """How many beams of each scan a file holds, at most."""
    return max(_FEWEST, min(_MOST_OF_A_SCAN, _MOST_OF_ALL // max(scan_count, 1)))


def read_journey(
    log: Log,
    models: Mapping[str, Sensor],
    *,
    beams: int = 0,
    progress: Callable[[int], None] | None = None,
) -> Journey:
    """Read a log through, once.

    Args:
        log: with one scan or more.
        models: of its sensors, by id; "" for all others.
        beams: how many of each scan to keep, at most.
        progress: called with the number of scans done so far.

    Raises:
        InputError: a scan cannot be read.
    """
    rows: list[tuple[float, ...]] = []
    stamps: list[int | None] = []
    numbers: dict[str, int] = {}
    whose: list[int] = []
    kept: list[DrawnBeams] = []
    for scan in log:
        rows.append(_where(scan))
        stamps.append(scan.stamp_ns)
        whose.append(numbers.setdefault(scan.sensor_id, len(numbers)))
        if beams:
            kept.append(beams_of(scan, models.get(scan.sensor_id) or models.get(""), beams))
        if progress is not None:
            progress(len(rows))
    table = np.array(rows)
    return Journey(
        table[:, 2:], table[:, 0], table[:, 1],
        np.array([stamp or 0 for stamp in stamps], np.int64),
        np.array([stamp is not None for stamp in stamps], np.int64),
        tuple(numbers), np.array(whose, np.int64), tuple(kept),
    )  # fmt: skip


def _where(scan: Measurement) -> tuple[float, ...]:
    """Yaw and pitch of where the sensor looks [rad], and its position [m]; NaN without a pose."""
    pose: Pose = scan.map_from_sensor
    if not pose.is_finite:
        return (math.nan,) * (2 + len(pose.translation))
    # A camera looks along z, all others along x.
    ahead = pose.rotation[:, 2 if isinstance(scan, DepthScan) else 0]
    pitch = math.asin(min(max(float(ahead[2]), -1.0), 1.0)) if len(ahead) == 3 else 0.0
    return (math.atan2(ahead[1], ahead[0]), pitch, *pose.translation.tolist())
