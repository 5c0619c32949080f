# SPDX-License-Identifier: Apache-2.0
"""What the caller states about a log because its files do not."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import Literal, get_args

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory
from oddsmap.scans.depth_image import PinholeCamera

__all__ = ["FilePath", "PointFrame", "ReadOptions"]

FilePath = str | os.PathLike[str]

PointFrame = Literal["sensor", "map"]
"""The frame in which the points of clouds are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """Arguments of `open_log`, described there."""

    poses: FilePath | Trajectory | None = None
    times: FilePath | None = None
    body_from_sensor: Pose3 | None = None
    camera: PinholeCamera | None = None
    skip_bad: bool = False
    tolerance_s: float | None = None
    points_in: PointFrame | None = None
    origin: tuple[float, float, float] | None = None
    columns: tuple[str, ...] | None = None
    depth_scale: float | None = None
    scans: tuple[str, ...] = ()
    frame: str | None = None
    clock_offset_s: float = 0.0
    deskew: bool | None = None

    def __post_init__(self) -> None:
        if self.tolerance_s is not None and not 0.0 <= self.tolerance_s < math.inf:
            raise ConfigError(f"tolerance_s is a time of 0 s or more, got {self.tolerance_s}")
        if self.points_in is not None and self.points_in not in get_args(PointFrame):
            raise ConfigError(f"points_in is 'sensor' or 'map', got {self.points_in!r}")
        if self.origin is not None:
            self._check_origin(self.origin)
        if self.depth_scale is not None and not 0.0 < self.depth_scale < math.inf:
            raise ConfigError(
                "depth_scale is how many units of a depth image make a metre (1000: they are in "
                f"millimetres), got {self.depth_scale}"
            )
        if self.columns is not None and [self.columns.count(axis) for axis in "xyz"] != [1, 1, 1]:
            raise ConfigError(
                f"columns are names with x, y and z once each, as x,y,z,intensity, got "
                f"{','.join(self.columns)!r}"
            )

        if not -4e9 < self.clock_offset_s < 4e9:
            raise ConfigError(f"clock_offset_s is a number of seconds, got {self.clock_offset_s}")

    def _check_origin(self, origin: tuple[float, float, float]) -> None:
        if len(origin) != 3 or not all(map(math.isfinite, origin)):
            raise ConfigError(f"origin is three numbers x y z [m], got {origin!r}"[:200])
        if self.poses is not None:
            raise ConfigError("origin is where a sensor stood that has no poses: leave one out")
        if self.points_in == "sensor":
            raise ConfigError("origin is for points in the map: leave points_in 'sensor' out")

    @property
    def tolerance_ns(self) -> int:
        """The tolerance [ns], by default 20 ms."""
        return round((0.02 if self.tolerance_s is None else self.tolerance_s) * 1e9)

    @property
    def points_in_map(self) -> bool:
        """The points are in the frame of the map."""
        return self.points_in == "map" or self.origin is not None

    def sensor_pose(self, map_from_body: Pose3) -> Pose3:
        """The pose of the sensor, given that of the body that carries it."""
        if self.body_from_sensor is None:
            return map_from_body
        return map_from_body @ self.body_from_sensor

    def refuse(self, path: str, format_name: str, *names: str) -> None:
        """Raise InputError where one of these arguments was given: nothing is ignored silently."""
        why = {
            "poses": "has poses",
            "times": "has its stamps with its poses",
            "body_from_sensor": "has the poses of its sensor",
            "camera": "holds no depth images",
            "points_in": "has its points in the frame of its sensor",
            "origin": "says where its sensor was",
            "columns": "has no .bin columns",
            "depth_scale": "holds no depth images",
            "scans": "has no topics",
            "frame": "has no frames",
            "clock_offset_s": "has its stamps with its poses",
            "deskew": "is not deskewed",
        }
        for name in names:
            if getattr(self, name) not in (None, (), 0.0):
                raise InputError(
                    f"{path}: {format_name} {why[name]}: leave `{name}` out for this log"
                )
