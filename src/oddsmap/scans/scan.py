# SPDX-License-Identifier: Apache-2.0
"""A measurement z_t of ranges, with its pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, InitVar, dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import InputError
from oddsmap.poses.given_pose import PoseLike, pose_of
from oddsmap.poses.pose import Pose, Pose2
from oddsmap.scans.given_stamp import Seconds, stamp_of
from oddsmap.scans.point_beams import beams_to, in_sensor_frame
from oddsmap.scans.readings import angles_in, check_unit, metres, numbers
from oddsmap.short_repr import short_repr

__all__ = ["Scan"]


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One measurement z_t: ranges along known directions, from a known pose.

    `from_angles`, `from_points` and `from_cone` make scans of what sensors give, and
    `DepthScan.from_depth` of depth images. Lists are as good as arrays.

    Args:
        map_from_sensor: pose of the sensor in the map frame, in any form of
            `oddsmap.poses.given_pose.PoseLike`.
        directions: unit vectors in the sensor frame, shape (n, d), d = 2 or 3. Scans of one
            sensor may share the array: it is never written to.
        ranges: distance along each direction [m], shape (n,). +Inf = nothing seen, NaN or
            -Inf = no information (REP-117).
        stamp_ns: time of the scan [ns], or None where the log has none to trust.

    Other Args:
        sensor_id: which of the log's sensors made it: a key of `Log.sensors`.
        number: which measurement of its log it is, counted from 0; None where nobody has counted.
        beam_times_ns: time of each beam [ns], shape (n,), where they were not taken at once.
        beam_origins: where each beam starts in the sensor frame [m], shape (n, d); None: at the
            sensor. A scan taken while the sensor moved has one for each beam, or for each group
            of beams taken at once; it is still one measurement, with one vote per cell. A beam
            whose origin is no number carries no information: its range becomes NaN.
        trusted: True: arrays of float64 and unit vectors by construction, which are not looked at
            again: that takes 10 us for 360 beams in 2D, 1.2 ms for 131,072 in 3D.

    Raises:
        InputError: the shapes do not fit each other, a direction is no unit vector though its beam
            says something, or the pose is none.
    """

    map_from_sensor: Pose
    directions: npt.NDArray[np.float64]
    ranges: npt.NDArray[np.float64]
    stamp_ns: int | None = None
    _: KW_ONLY
    sensor_id: str = ""
    number: int | None = None
    beam_times_ns: IntArray | None = None
    beam_origins: FloatArray | None = None
    trusted: InitVar[bool] = False
    measured_points: FloatArray | None = field(default=None, init=False, repr=False)
    """The ends of the beams in the sensor frame [m], shape (n, d), where the sensor gave points.

    `directions * ranges` is rounded, and puts one point in thirty of a flat wall that lies on a
    border of cells into the cell before it: what was measured as a point marks as that point.
    Where beams have origins they are counted from these.
    """
    own_vectors: FloatArray | None = field(default=None, init=False, repr=False)
    """`directions` or `measured_points` in the frame of the sensor at the time of each beam, where
    that is another one: what the robot's own body and angles of beams are told in, shape (n, d)."""
    stated: Mapping[str, float] = field(default_factory=dict, init=False, repr=False)
    """What its log states about the sensor, by the names of the configuration; logs set it."""

    __repr__ = short_repr

    def __post_init__(self, trusted: bool) -> None:
        if not trusted:
            object.__setattr__(self, "map_from_sensor", pose_of(self.map_from_sensor))
            object.__setattr__(self, "directions", numbers(self.directions, "directions"))
            object.__setattr__(self, "ranges", metres(self.ranges, "ranges"))
            object.__setattr__(self, "stamp_ns", stamp_of(None, None, self.stamp_ns))
            if self.beam_times_ns is not None:
                times = np.asarray(self.beam_times_ns)
                if times.dtype.kind not in "iu":
                    raise InputError(
                        f"beam_times_ns are whole nanoseconds, got an array of {times.dtype}"
                    )
                object.__setattr__(self, "beam_times_ns", times.astype(np.int64, copy=False))
        d = 2 if isinstance(self.map_from_sensor, Pose2) else 3
        n = self.ranges.size
        if self.ranges.ndim != 1 or self.directions.shape != (n, d):
            raise InputError(
                f"a scan with a {d}D pose needs ranges (n,) and directions (n, {d}), "
                f"got {self.ranges.shape} and {self.directions.shape}"
            )
        if not trusted:
            check_unit(self.directions, self.ranges)
        for name, shape in (("beam_times_ns", (n,)), ("beam_origins", (n, d))):
            value = getattr(self, name)
            if value is not None and np.shape(value) != shape:
                raise InputError(f"{name} of this scan has shape {shape}, got {np.shape(value)}")
        if self.beam_origins is not None:
            self._check_origins(np.asarray(self.beam_origins, np.float64))

    def _check_origins(self, origins: FloatArray) -> None:
        """Take a beam from nowhere as one that says nothing."""
        finite = np.isfinite(origins)
        if not finite.all():  # by rows only then: that takes 6 ms for 65,536 beams
            nowhere = np.asarray(~finite.all(axis=1))
            origins = np.where(nowhere[:, None], 0.0, origins)
            object.__setattr__(self, "ranges", np.where(nowhere, np.nan, self.ranges))
        object.__setattr__(self, "beam_origins", origins)

    @property
    def size(self) -> int:
        """How many readings there are."""
        return len(self.ranges)

    @classmethod
    def from_angles(
        cls,
        pose: PoseLike,
        angles: npt.ArrayLike,
        ranges: npt.ArrayLike,
        *,
        stamp: object = None,
        stamp_s: Seconds | None = None,
        stamp_ns: int | None = None,
        sensor_id: str = "",
    ) -> Scan:
        """Take ranges at angles, as 2D laser scanners give them.

        Args:
            pose: of the sensor in the map frame: (x, y, yaw), or any form of
                `oddsmap.poses.given_pose.PoseLike`. With a pose in space the scan is one of a 3D
                map, its beams in the sensor's x-y plane.
            angles: direction of each beam [rad], from the sensor's x axis, counter-clockwise, shape
                (n,).
            ranges: distance along each [m], shape (n,). +Inf = nothing seen, NaN = no information.

        Other Args:
            stamp: time of the scan, where it knows its unit: a `datetime` with its time zone, a
                `numpy.datetime64`, the stamp of a ROS message.
            stamp_s: time of the scan [s].
            stamp_ns: time of the scan [ns].
            sensor_id: which of several sensors made it.

        Raises:
            InputError: a shape, a pose or a stamp is none of these, or the angles are degrees.
        """
        where, ways, far = pose_of(pose), angles_in(angles), np.atleast_1d(metres(ranges, "ranges"))
        if far.shape != ways.shape:
            raise InputError(
                f"a scan needs as many ranges as angles, got {far.shape} ranges and {ways.shape} "
                "angles"
            )
        directions = np.zeros((len(ways), 2 if isinstance(where, Pose2) else 3))
        directions[:, 0], directions[:, 1] = np.cos(ways), np.sin(ways)
        time = stamp_of(stamp, stamp_s, stamp_ns)
        return cls(where, directions, far, time, sensor_id=sensor_id, trusted=True)

    @classmethod
    def from_cone(
        cls,
        pose: PoseLike,
        angles: npt.ArrayLike,
        ranges: npt.ArrayLike,
        *,
        cone_deg: float,
        stamp: object = None,
        stamp_s: Seconds | None = None,
        stamp_ns: int | None = None,
        sensor_id: str = "",
    ) -> Scan:
        """Take echoes of wide beams, as sonars and radars give them.

        The scan states how wide they are: `build_map` takes a `ConeSensor` for it, and a map of
        another sensor refuses it.

        Args:
            pose: of the sensor, as in `from_angles`.
            angles: where the axis of each cone points [rad], shape (n,), or one number.
            ranges: distance of each echo [m], shape (n,), or one number. +Inf = none came back.
            cone_deg: full width of the cones [deg].

        Other Args:
            stamp: as in `from_angles`.
            stamp_s: time of the scan [s].
            stamp_ns: time of the scan [ns].
            sensor_id: which of several sensors made it.

        Raises:
            InputError: as in `from_angles`, or the width is outside (0, 180].
        """
        if not 0.0 < cone_deg <= 180.0:
            raise InputError(
                f"cone_deg is the full width of a cone [deg], 0 to 180, got {cone_deg}"
            )
        scan = cls.from_angles(
            pose, angles, ranges, stamp=stamp, stamp_s=stamp_s, stamp_ns=stamp_ns,
            sensor_id=sensor_id,
        )  # fmt: skip
        object.__setattr__(scan, "stated", {"cone_deg": float(cone_deg)})
        return scan

    @classmethod
    def from_points(
        cls,
        pose: PoseLike,
        points: npt.ArrayLike,
        stamp_ns: int | None = None,
        *,
        points_in: Literal["sensor", "map"] = "sensor",
        stamp: object = None,
        stamp_s: Seconds | None = None,
        sensor_id: str = "",
    ) -> Scan:
        """Take the points of a cloud as the ends of beams from the sensor.

        `directions * ranges[:, None]` gives the points back to within a few roundings of float64;
        `measured_points` are the points themselves, and what they mark is where they are.

        Args:
            pose: of the sensor in the map frame, in any form of
                `oddsmap.poses.given_pose.PoseLike`.
            points: points [m], shape (n, 3), or (n, 2) with a pose in the plane. One that is not
                finite becomes a range of NaN, so that it is counted; one at the sensor itself has
                range 0, which is counted as well and marks nothing.
            stamp_ns: time of the scan [ns].

        Other Args:
            points_in: "sensor": points are in the sensor frame; "map": in the map frame. There and
                back they are rounded: a point on a border of cells may mark either.
            stamp: as in `from_angles`.
            stamp_s: time of the scan [s].
            sensor_id: which of several sensors made it.

        Raises:
            InputError: `points` has another shape, or what `from_angles` refuses.
        """
        where, ends = pose_of(pose), metres(points, "points")
        d = 2 if isinstance(where, Pose2) else 3
        if ends.ndim != 2 or ends.shape[1] != d:
            raise InputError(
                f"the points of a scan have shape (n, {d}) with a {d}D pose, got {ends.shape}"
            )
        if points_in == "map":
            ends = in_sensor_frame(where, ends)
        elif points_in != "sensor":
            raise InputError(f'points_in is "sensor" or "map", got {points_in!r}')
        directions, ranges = beams_to(ends)
        time = stamp_of(stamp, stamp_s, stamp_ns)
        scan = cls(where, directions, ranges, time, sensor_id=sensor_id, trusted=True)
        object.__setattr__(scan, "measured_points", ends)
        return scan
