# SPDX-License-Identifier: Apache-2.0
"""A measurement z_t of ranges, with its pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose, Pose2, Pose3

__all__ = ["Scan"]


# Whose square is well within what doubles hold.
_SAFE = 1e-140


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One measurement z_t: ranges along known directions, from a known pose.

    Args:
        map_from_sensor: pose of the sensor in the map frame.
        directions: unit vectors in the sensor frame, shape (n, d), d = 2 or 3. Scans of one
            sensor may share the array: it is never written to.
        ranges: distance along each direction [m], shape (n,). +Inf = nothing seen, NaN or
            -Inf = no information (REP-117).
        stamp_ns: time of the scan [ns], or None where the log has none to trust.

    Other Args:
        sensor_id: which of the log's sensors made it: a key of `Log.sensors`.
        beam_times_ns: time of each beam [ns], shape (n,), where they were not taken at once.
        beam_origins: where each beam starts in the sensor frame [m], shape (n, d); None: at the
            sensor. A scan taken while the sensor moved has one for each beam, or for each group
            of beams taken at once; it is still one measurement, with one vote per cell. A beam
            whose origin is no number carries no information: its range becomes NaN.

    Raises:
        InputError: the shapes do not fit each other.
    """

    map_from_sensor: Pose
    directions: npt.NDArray[np.float64]
    ranges: npt.NDArray[np.float64]
    stamp_ns: int | None = None
    _: KW_ONLY
    sensor_id: str = ""
    beam_times_ns: IntArray | None = None
    beam_origins: FloatArray | None = None
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

    def __post_init__(self) -> None:
        d = 2 if isinstance(self.map_from_sensor, Pose2) else 3
        n = len(self.ranges)
        if self.ranges.ndim != 1 or self.directions.shape != (n, d):
            raise InputError(
                f"a scan with a {d}D pose needs ranges (n,) and directions (n, {d}), "
                f"got {self.ranges.shape} and {self.directions.shape}"
            )
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
    def from_points(
        cls, map_from_sensor: Pose3, points: npt.ArrayLike, stamp_ns: int | None = None
    ) -> Scan:
        """Take the points of a cloud as the ends of beams from the sensor.

        `directions * ranges[:, None]` gives the points back to within a few roundings of float64;
        `measured_points` are the points themselves, and what they mark is where they are.

        Args:
            map_from_sensor: pose of the sensor in the map frame.
            points: points in the sensor frame [m], shape (n, 3). One that is not finite becomes a
                range of NaN, so that it is counted; one at the sensor itself has range 0, which is
                counted as well and marks nothing.
            stamp_ns: time of the scan [ns].

        Raises:
            InputError: `points` has another shape.
        """
        ends = np.asarray(points, dtype=np.float64)
        if ends.ndim != 2 or ends.shape[1] != 3:
            raise InputError(f"the points of a scan have shape (n, 3), got {ends.shape}")
        with np.errstate(invalid="ignore", over="ignore", under="ignore"):
            ranges = np.sqrt(ends[:, 0] ** 2 + ends[:, 1] ** 2 + ends[:, 2] ** 2)
            # Squares overflow and underflow half way to the ends of what doubles hold.
            odd = ~((ranges > _SAFE) & (ranges < 1 / _SAFE))
            ranges[odd] = np.hypot(np.hypot(ends[odd, 0], ends[odd, 1]), ends[odd, 2])
        ranges[~np.isfinite(ranges)] = np.nan
        unusable = ~(ranges > 0)
        directions = ends / np.where(unusable, 1.0, ranges)[:, None]
        directions[unusable] = (1.0, 0.0, 0.0)
        scan = cls(map_from_sensor, directions, ranges, stamp_ns)
        object.__setattr__(scan, "measured_points", ends)
        return scan
