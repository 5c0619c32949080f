# SPDX-License-Identifier: Apache-2.0
"""A measurement of cells: a grid of labels or probabilities, with its pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.poses.given_pose import pose_of
from oddsmap.poses.pose import Pose2
from oddsmap.short_repr import short_repr

__all__ = ["GridScan"]


@dataclass(frozen=True, slots=True, eq=False)
class GridScan:
    """One z_t of a sensor that sees cells: a grid of labels or probabilities, at a pose.

    Args:
        map_from_sensor: pose of the sensor in the map frame, in any form of
            `oddsmap.poses.given_pose.PoseLike`.
        seen: what each pixel says, shape (h, w), rows = y (left) of the sensor ascending, columns =
            x (forward). 1: seen occupied, 0: seen free, NaN: not seen; in between: the detector's
            probability that the place is occupied, at prior 1/2. Labels may be whole numbers or
            bool.
        resolution: side of a pixel [m].
        corner: position of the lower left corner of pixel (0, 0) in the sensor frame [m].
        stamp_ns: time of the scan [ns], or None where the log has none to trust.
        sensor_id: which of the log's sensors made it: a key of `Log.sensors`.
        number: which measurement of its log it is, counted from 0; None where nobody has counted.

    Raises:
        InputError: another shape, values outside [0, 1], a side that is not positive, a corner
            that is not finite, or no pose in the plane.
    """

    map_from_sensor: Pose2
    seen: npt.NDArray[Any]
    resolution: float
    corner: tuple[float, float]
    stamp_ns: int | None = None
    sensor_id: str = ""
    number: int | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        where = pose_of(self.map_from_sensor)
        if not isinstance(where, Pose2):
            raise InputError("a grid scan needs a pose in the plane, (x, y, yaw), got one in space")
        object.__setattr__(self, "map_from_sensor", where)
        seen = np.asarray(self.seen)
        if seen.ndim != 2 or seen.size == 0 or seen.dtype.kind not in "biuf":
            raise InputError(
                "a grid scan needs numbers of shape (h, w), at least one, got "
                f"{seen.dtype} of shape {seen.shape}"
            )
        seen = seen.astype(np.float64)
        wrong = (seen < 0.0) | (seen > 1.0)
        if wrong.any():
            row, column = (int(i) for i in np.argwhere(wrong)[0])
            raise InputError(
                "a grid scan holds 0 (free) to 1 (occupied) and NaN (not seen), got "
                f"{seen[row, column]:g} in row {row}, column {column}"
            )
        if not 0.0 < self.resolution < math.inf:
            raise InputError(
                f"the pixels of a grid scan need a side above 0 m, got {self.resolution}"
            )
        if len(self.corner) != 2 or not all(math.isfinite(at) for at in self.corner):
            raise InputError(f"the corner of a grid scan is a point x, y [m], got {self.corner}")
        object.__setattr__(self, "seen", seen)

    @property
    def size(self) -> int:
        """How many readings there are."""
        return int(self.seen.size)
