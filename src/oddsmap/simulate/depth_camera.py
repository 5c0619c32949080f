# SPDX-License-Identifier: Apache-2.0
"""A depth camera with noise, in a world of solids."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from oddsmap.errors import ConfigError
from oddsmap.poses.pose import Pose3
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.simulate.lidar3d import check_pose
from oddsmap.simulate.world3d import World3D

__all__ = ["DepthCamera"]

_KINECT = PinholeCamera(fx=525.0, fy=525.0, cx=319.5, cy=239.5, width=640, height=480)


@dataclass(frozen=True, slots=True)
class DepthCamera:
    """A pinhole camera that reads, for each pixel, the depth of the first surface.

    Depth is measured along the optical axis. It gets Gaussian noise whose standard deviation grows
    with the square of the depth, and is 0 (nothing known) where the surface is nearer than
    `range_min`, at `range_max` or beyond, or the noise takes the reading there.

    Args:
        camera: the intrinsics; by default 640 x 480 pixels over 63 x 49 degrees.
        range_min: smallest depth [m].
        range_max: every depth is below it [m].
        sigma: standard deviation of the noise at 1 m [m].

    Raises:
        ConfigError: a parameter outside its range.

    Source:
        Khoshelham, Oude Elberink: Accuracy and resolution of Kinect depth data (2012): 1.4 mm at
        1 m, growing with the square of the depth.
    """

    camera: PinholeCamera = _KINECT
    range_min: float = 0.4
    range_max: float = 6.0
    sigma: float = 0.0014

    def __post_init__(self) -> None:
        if not 0 <= self.range_min < self.range_max < math.inf:
            raise ConfigError(
                "DepthCamera: 0 <= range_min < range_max must hold [m], "
                f"got {self.range_min} and {self.range_max}"
            )
        if not (math.isfinite(self.sigma) and self.sigma >= 0):
            raise ConfigError(f"DepthCamera: sigma must be 0 m or more, got {self.sigma}")

    def scan(
        self,
        world: World3D,
        pose: Pose3,
        rng: np.random.Generator,
        *,
        stamp_ns: int | None = None,
    ) -> DepthScan:
        """Take one picture.

        The same generator state gives the same picture.

        Args:
            world: what stands where, in the map frame.
            pose: of the optical frame in the map frame: x right, y down, z forward.
            rng: where the chance comes from.
            stamp_ns: time of the picture [ns], handed on.

        Returns:
            The picture and its pose.

        Raises:
            InputError: the pose is not finite or stands inside a solid or the ground.
        """
        check_pose("DepthCamera.scan", world, pose)
        per_depth = self.camera.range_per_depth
        directions = self.camera.directions @ pose.rotation.T
        reach = self.range_max * float(per_depth.max())
        ranges = world.cast(pose.translation, directions, reach=reach).reshape(per_depth.shape)
        true_depths = ranges / per_depth
        noise = self.sigma * rng.standard_normal(ranges.shape)
        seen = true_depths < self.range_max
        depths = np.zeros(ranges.shape)
        depths[seen] = true_depths[seen] + noise[seen] * true_depths[seen] ** 2
        image = depths.astype(np.float32)
        image[(image < self.range_min) | (image >= self.range_max)] = 0.0
        return DepthScan(pose, image, self.camera, stamp_ns)
