# SPDX-License-Identifier: Apache-2.0
"""Depth cameras: the pinhole model, and one depth image with its pose.

The optical frame has x to the right of the image, y down and z forward, along which depth is
measured. Pixel (u, v) is column u, row v; its centre is at (u, v) itself.

Source: Hartley, Zisserman: Multiple View Geometry (2004), section 6.1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose3
from oddsmap.scans.scan import Scan

__all__ = ["DepthScan", "PinholeCamera"]


@dataclass(frozen=True, slots=True)
class PinholeCamera:
    """A camera without distortion.

    Args:
        fx: focal length in columns [pixels]. Negative: the x axis points to the left.
        fy: focal length in rows [pixels]. Negative: the y axis points up (ICL-NUIM).
        cx: column of the principal point [pixels].
        cy: row of the principal point [pixels].
        width: columns of the image.
        height: rows of the image.

    Raises:
        ConfigError: a focal length is 0 or not finite, or the image has no pixels.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        for name in ("fx", "fy"):
            value = getattr(self, name)
            if not math.isfinite(value) or value == 0.0:
                raise ConfigError(f"camera.{name} is a focal length in pixels, got {value}")
        for name in ("cx", "cy"):
            value = getattr(self, name)
            if not math.isfinite(value):
                raise ConfigError(f"camera.{name} is a position in pixels, got {value}")
        for name in ("width", "height"):
            value = getattr(self, name)
            if not value >= 1 or value != int(value):
                raise ConfigError(f"camera.{name} is a count of pixels, got {value}")

    @property
    def directions(self) -> FloatArray:
        """Unit vectors through the pixels in the optical frame, row by row, shape (h * w, 3).

        Computed once for a camera, shared and read-only.
        """
        return _rays(self).directions

    @property
    def range_per_depth(self) -> FloatArray:
        """Distance along each pixel's ray at depth 1, shape (h, w), shared and read-only."""
        return _rays(self).lengths


class _Rays(NamedTuple):
    points: FloatArray
    """Where the rays are at depth 1, row by row, shape (h * w, 3)."""
    directions: FloatArray
    """Unit vectors, shape (h * w, 3)."""
    lengths: FloatArray
    """Way to those points, shape (h, w)."""


@lru_cache(maxsize=4)
def _rays(camera: PinholeCamera) -> _Rays:
    x = (np.arange(camera.width) - camera.cx) / camera.fx
    y = (np.arange(camera.height) - camera.cy) / camera.fy
    rays = np.ones((camera.height, camera.width, 3))
    rays[..., 0], rays[..., 1] = x[None, :], y[:, None]
    length = np.sqrt(np.square(rays).sum(axis=2))
    directions = (rays / length[..., None]).reshape(-1, 3)
    points = rays.reshape(-1, 3)
    points.flags.writeable = directions.flags.writeable = length.flags.writeable = False
    return _Rays(points, directions, length)


@dataclass(frozen=True, slots=True, eq=False)
class DepthScan:
    """One depth image with its pose.

    Args:
        map_from_sensor: pose of the optical frame in the map frame.
        depth: distance along z [m], shape (h, w), float32. 0, negative, NaN and infinite pixels
            carry no information.
        camera: the intrinsics.
        stamp_ns: time of the image [ns], or None where the log has none to trust.
        sensor_id: which of the log's sensors made it: a key of `Log.sensors`.

    Raises:
        InputError: the image has another size than the intrinsics are for.
    """

    map_from_sensor: Pose3
    depth: npt.NDArray[np.float32]
    camera: PinholeCamera
    stamp_ns: int | None = None
    sensor_id: str = ""
    stated: Mapping[str, float] = field(default_factory=dict, init=False, repr=False)
    """What its log states about the sensor, by the names of the configuration; logs set it."""

    def __post_init__(self) -> None:
        if self.depth.shape != (self.camera.height, self.camera.width):
            size = " x ".join(str(n) for n in self.depth.shape[::-1])
            raise InputError(
                f"the depth image is {size} pixels, the intrinsics are for "
                f"{self.camera.width} x {self.camera.height}: give the camera of this image"
            )

    @property
    def size(self) -> int:
        """How many readings there are."""
        return int(self.depth.size)

    def to_scan(self) -> Scan:
        """One beam per pixel, row by row; pixels without information have range NaN."""
        depth = self.depth.astype(np.float64)
        with np.errstate(invalid="ignore"):
            ranges = np.where(
                (depth > 0) & np.isfinite(depth), depth * self.camera.range_per_depth, np.nan
            )
        scan = Scan(
            self.map_from_sensor,
            self.camera.directions,
            ranges.ravel(),
            self.stamp_ns,
            sensor_id=self.sensor_id,
        )
        with np.errstate(invalid="ignore"):  # depths that are infinite, at x = 0
            points = _rays(self.camera).points * depth.reshape(-1, 1)
        object.__setattr__(scan, "measured_points", points)
        object.__setattr__(scan, "stated", self.stated)
        return scan
