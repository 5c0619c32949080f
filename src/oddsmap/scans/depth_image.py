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
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.given_pose import PoseLike, pose_of
from oddsmap.poses.pose import Pose3
from oddsmap.scans.given_stamp import Seconds, stamp_of
from oddsmap.scans.readings import numbers
from oddsmap.scans.scan import Scan
from oddsmap.short_repr import short_repr

__all__ = ["CameraLike", "DepthScan", "PinholeCamera", "camera_of"]


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


CameraLike: TypeAlias = PinholeCamera | npt.ArrayLike
"""Intrinsics: a `PinholeCamera`, the 3 x 3 matrix K, or (fx, fy, cx, cy) [pixels]."""


def camera_of(given: CameraLike, height: int, width: int) -> PinholeCamera:
    """The intrinsics that are meant, of an image of this size.

    Raises:
        InputError: they are in none of the forms of `CameraLike`.
    """
    if isinstance(given, PinholeCamera):
        return given
    values = numbers(given, "camera")
    if values.shape == (3, 3):
        (fx, skew, cx), (low, fy, cy), last = values.tolist()
        if skew or low or last != [0.0, 0.0, 1.0]:
            raise InputError(
                f"the camera matrix is fx 0 cx, 0 fy cy, 0 0 1; got {values.tolist()}: an image "
                "that is distorted or skewed has to be rectified first"
            )
    elif values.shape == (4,):
        fx, fy, cx, cy = values.tolist()
    else:
        raise InputError(
            "a camera is a PinholeCamera, a matrix of 3 x 3 or (fx, fy, cx, cy), got numbers of "
            f"shape {values.shape}"
        )
    return PinholeCamera(fx, fy, cx, cy, width, height)


def _in_space(pose: PoseLike) -> Pose3:
    where = pose_of(pose)
    if not isinstance(where, Pose3):
        raise InputError(
            "a depth image needs the pose of its camera in space, a 4 x 4 matrix or a Pose3, got "
            "one in the plane"
        )
    return where


def _check_metres(depth: npt.ArrayLike) -> None:
    """Refuse an image of integers, which count steps."""
    dtype = np.asarray(depth).dtype
    if dtype.kind in "biu":
        raise InputError(
            f"a depth image of {dtype} needs depth_unit, the metres of one step: "
            "DepthScan.from_depth(..., depth_unit=0.001) for millimetres"
        )


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
        depth: distance along z [m], shape (h, w), floats. 0, negative, NaN
            and infinite pixels carry no information.
        camera: the intrinsics.
        stamp_ns: time of the image [ns], or None where the log has none to trust.
        sensor_id: which of the log's sensors made it: a key of `Log.sensors`.
        number: which measurement of its log it is, counted from 0; None where nobody has counted.

    Raises:
        InputError: the image has another size than the intrinsics are for, holds integers, or the
            pose is none in space.
    """

    map_from_sensor: Pose3
    depth: npt.NDArray[np.floating[Any]]
    camera: PinholeCamera
    stamp_ns: int | None = None
    sensor_id: str = ""
    number: int | None = None
    stated: Mapping[str, float] = field(default_factory=dict, init=False, repr=False)
    """What its log states about the sensor, by the names of the configuration; logs set it."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "map_from_sensor", _in_space(self.map_from_sensor))
        if not isinstance(self.depth, np.ndarray) or self.depth.dtype.kind != "f":
            _check_metres(self.depth)
            object.__setattr__(self, "depth", numbers(self.depth, "depth"))
        if self.depth.shape != (self.camera.height, self.camera.width):
            size = " x ".join(str(n) for n in self.depth.shape[::-1])
            raise InputError(
                f"the depth image is {size} pixels, the intrinsics are for "
                f"{self.camera.width} x {self.camera.height}: give the camera of this image"
            )

    @classmethod
    def from_depth(
        cls,
        pose: PoseLike,
        depth: npt.ArrayLike,
        camera: CameraLike,
        *,
        depth_unit: float | None = None,
        stamp: object = None,
        stamp_s: Seconds | None = None,
        stamp_ns: int | None = None,
        sensor_id: str = "",
    ) -> DepthScan:
        """Take a depth image as cameras give it.

        Args:
            pose: of the optical frame (x right, y down, z forward) in the map frame, in space: in
                any form of `oddsmap.poses.given_pose.PoseLike`.
            depth: distance along z, shape (h, w). 0, negative, NaN and infinite pixels carry no
                information.
            camera: a `PinholeCamera`, the 3 x 3 matrix K, or (fx, fy, cx, cy) [pixels].
            depth_unit: metres for each step of `depth`: 0.001 for millimetres. Floats are metres
                by default; images of integers need it.

        Other Args:
            stamp: as in `Scan.from_angles`.
            stamp_s: time of the image [s].
            stamp_ns: time of the image [ns].
            sensor_id: which of several sensors made it.

        Raises:
            InputError: a shape, a pose, a camera or a stamp is none of these, or nothing says what
                the integers of an image mean.
            ConfigError: the camera has a focal length of 0.
        """
        if depth_unit is None:
            _check_metres(depth)
        elif not 0.0 < depth_unit < math.inf:
            raise InputError(f"depth_unit is the metres of one step, above 0, got {depth_unit}")
        image = numbers(depth, "depth")
        if image.ndim != 2:
            raise InputError(f"a depth image has shape (h, w), got {image.shape}")
        with np.errstate(over="ignore"):
            image = image * (1.0 if depth_unit is None else depth_unit)
        return cls(
            _in_space(pose),
            image,
            camera_of(camera, *image.shape),
            stamp_of(stamp, stamp_s, stamp_ns),
            sensor_id,
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
            number=self.number,
            trusted=True,
        )
        with np.errstate(invalid="ignore"):  # depths that are infinite, at x = 0
            points = _rays(self.camera).points * depth.reshape(-1, 1)
        object.__setattr__(scan, "measured_points", points)
        object.__setattr__(scan, "stated", self.stated)
        return scan
