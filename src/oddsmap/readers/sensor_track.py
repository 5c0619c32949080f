# SPDX-License-Identifier: Apache-2.0
"""Where a sensor was at many times: for points that are in the map already.

Such points need no rotation of the sensor, only the place where each of their rays starts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory, format_seconds
from oddsmap.scans.scan import Scan

__all__ = ["SensorTrack", "pose_at", "scan_seen_from"]


@dataclass(frozen=True, slots=True, eq=False)
class SensorTrack:
    """Places of a sensor over time.

    Args:
        stamps_ns: their times [ns], increasing, shape (n,).
        places: where the sensor was in the map [m], shape (n, 3).
        tolerance_ns: how far the nearer of the two neighbours of a time may be from it [ns].
        path: what messages start with.
    """

    stamps_ns: IntArray
    places: FloatArray
    tolerance_ns: int
    path: str

    @classmethod
    def of(
        cls, trajectory: Trajectory, body_from_sensor: Pose3 | None, tolerance_ns: int
    ) -> SensorTrack:
        """The track of a sensor on a body that moved.

        Between two poses of the body the sensor is taken to move along a straight line.

        Raises:
            InputError: poses without stamps, or two different ones of one stamp.
        """
        stamps, places = trajectory.stamps_ns, trajectory.positions
        if stamps is None:
            raise InputError(
                f"{trajectory.path}: the poses have no stamps: points that were taken on the move "
                "are matched by time (TUM, or a header that names a stamp)"
            )
        if body_from_sensor is not None:
            places = places + trajectory.rotations @ body_from_sensor.translation
        order = np.argsort(stamps, kind="stable")
        stamps, places = stamps[order], places[order]
        twice = np.flatnonzero(np.diff(stamps) == 0)
        if len(twice) and (places[twice] != places[twice + 1]).any():
            raise InputError(
                f"{trajectory.path}: two different poses have the stamp "
                f"{format_seconds(int(stamps[twice[0]]))}: take one of them out"
            )
        kept = np.append(True, np.diff(stamps) > 0)
        return cls(stamps[kept], places[kept], tolerance_ns, trajectory.path)

    def at(self, times_ns: IntArray) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Where the sensor was, and whether that is known.

        Args:
            times_ns: times [ns], shape (n,).

        Returns:
            Places [m], shape (n, 3), and True where there is a pose of this time, or one on each
            side, the nearer one within the tolerance, shape (n,). Nothing is extrapolated.
        """
        last = len(self.stamps_ns) - 1
        before = np.clip(np.searchsorted(self.stamps_ns, times_ns, "right") - 1, 0, last)
        after = np.minimum(before + 1, last)
        since, until = times_ns - self.stamps_ns[before], self.stamps_ns[after] - times_ns
        known = (since == 0) | (
            (since > 0) & (until > 0) & (np.minimum(since, until) <= self.tolerance_ns)
        )
        whole = np.where(after > before, self.stamps_ns[after] - self.stamps_ns[before], 1)
        share = np.where(known, since / whole, 0.0)[:, None]
        places = (1.0 - share) * self.places[before] + share * self.places[after]
        return places, known


def pose_at(place: FloatArray) -> Pose3:
    """A sensor at a place [m], shape (3,), with the axes of the map, for points that are in it."""
    return Pose3(np.array(place, np.float64), np.eye(3))


def scan_seen_from(points: FloatArray, origins: FloatArray, times_ns: IntArray) -> Scan:
    """One scan of points in the map, each seen from a place of its own.

    Its pose is the first of these places, with the axes of the map.

    Args:
        points: in the map [m], shape (n, 3), n at least 1.
        origins: where the ray of each point starts in the map [m], shape (n, 3).
        times_ns: time of each point [ns], shape (n,).
    """
    pose = pose_at(origins[0])
    scan = Scan.from_points(pose, points - origins, int(times_ns[0]))
    object.__setattr__(scan, "beam_times_ns", times_ns)
    object.__setattr__(scan, "beam_origins", origins - pose.translation)
    return scan
