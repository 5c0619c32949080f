# SPDX-License-Identifier: Apache-2.0
"""A spinning lidar: rings of beams, one above the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose3
from oddsmap.scans.scan import Scan
from oddsmap.simulate.world3d import World3D

__all__ = ["Lidar3D"]

# No reading is shorter [m]: noise in front of a close wall gives no zero or negative range.
_SHORTEST = 1e-3


@dataclass(frozen=True, slots=True)
class Lidar3D:
    """Rings of beams around the sensor's z axis.

    A beam reads the distance to the first surface plus Gaussian noise of `sigma`; +Inf where that
    surface is at `range_max` or beyond, or the noise takes the reading there. No reading is below
    1 mm: shorter ones become 1 mm. A `scan` is taken at once, a `sweep` while the sensor moves.

    Args:
        ring_count: rings; ring 0 is the highest.
        column_count: beams in a ring; column 0 looks along x, the others follow anticlockwise.
        elevation_min: of the lowest ring above the sensor's xy plane [rad].
        elevation_max: of the highest ring [rad].
        range_max: every reading is below it, or +Inf [m].
        sigma: standard deviation of the noise [m].

    Raises:
        ConfigError: a parameter outside its range.
    """

    ring_count: int = 64
    column_count: int = 1024
    elevation_min: float = math.radians(-25)
    elevation_max: float = math.radians(15)
    range_max: float = 50.0
    sigma: float = 0.02
    directions: npt.NDArray[np.float64] = field(init=False, repr=False, compare=False)
    """Unit vectors in the sensor frame, ring by ring, shape (ring_count * column_count, 3), shared
    by all scans."""

    def __post_init__(self) -> None:
        _check(self)
        elevation = np.linspace(self.elevation_max, self.elevation_min, self.ring_count)[:, None]
        azimuth = np.arange(self.column_count) * (2 * math.pi / self.column_count)
        x, y = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
        z = np.broadcast_to(np.sin(elevation), x.shape)
        directions = np.stack([x, y, z], axis=-1).reshape(-1, 3)
        directions.flags.writeable = False
        object.__setattr__(self, "directions", directions)

    def scan(
        self,
        world: World3D,
        pose: Pose3,
        rng: np.random.Generator,
        *,
        stamp_ns: int | None = None,
        returns_only: bool = False,
    ) -> Scan:
        """Take one scan.

        The same generator state gives the same scan.

        Args:
            world: what stands where, in the map frame.
            pose: of the sensor in the map frame.
            rng: where the chance comes from.
            stamp_ns: time of the scan [ns], handed on.
            returns_only: leave out the beams without a return, as a point cloud does.

        Returns:
            The scan, ranges [m], ring by ring, +Inf = no return. All beams share `directions`;
            with `returns_only` the scan has an array of its own.

        Raises:
            InputError: the pose is not finite or stands inside a solid or the ground.
        """
        check_pose("Lidar3D.scan", world, pose)
        directions = self.directions @ pose.rotation.T
        true_ranges = world.cast(pose.translation, directions, reach=self.range_max)
        noise = self.sigma * rng.standard_normal(len(directions))
        ranges = np.where(true_ranges < self.range_max, true_ranges + noise, np.inf)
        ranges[ranges >= self.range_max] = np.inf
        ranges = np.maximum(ranges, _SHORTEST)
        if returns_only:
            seen = np.isfinite(ranges)
            return Scan(pose, self.directions[seen], ranges[seen], stamp_ns, trusted=True)
        return Scan(pose, self.directions, ranges, stamp_ns, trusted=True)

    def sweep(
        self,
        world: World3D,
        poses: Sequence[Pose3],
        rng: np.random.Generator,
        *,
        stamp_ns: int = 0,
        column_ns: int = 100_000,
    ) -> Scan:
        """Take one scan while the sensor moves: column after column, each from its own pose.

        What comes out is what a driver hands on: readings along the beams of the sensor, the pose
        at the stamp, which is that of the first column, and the time of each beam.

        Args:
            world: what stands where, in the map frame.
            poses: of the sensor in the map frame, one for each column.
            rng: where the chance comes from.
            stamp_ns: time of the first column [ns].
            column_ns: from one column to the next [ns].

        Returns:
            The scan, ranges [m], ring by ring, +Inf = no return, with `beam_times_ns`.

        Raises:
            InputError: another count of poses, or one that no sensor can have.
        """
        if len(poses) != self.column_count:
            raise InputError(
                f"Lidar3D.sweep: one pose for each of {self.column_count} columns, got {len(poses)}"
            )
        by_columns = self.directions.reshape(self.ring_count, self.column_count, 3)
        ranges = np.empty((self.ring_count, self.column_count))
        for column, pose in enumerate(poses):
            check_pose("Lidar3D.sweep", world, pose)
            directions = by_columns[:, column] @ pose.rotation.T
            ranges[:, column] = world.cast(pose.translation, directions, reach=self.range_max)
        noise = self.sigma * rng.standard_normal(ranges.shape)
        ranges = np.where(ranges < self.range_max, ranges + noise, np.inf)
        ranges[ranges >= self.range_max] = np.inf
        times = np.tile(stamp_ns + column_ns * np.arange(self.column_count), self.ring_count)
        return Scan(
            poses[0],
            self.directions,
            np.maximum(ranges, _SHORTEST).ravel(),
            stamp_ns,
            beam_times_ns=times,
            trusted=True,
        )


def check_pose(who: str, world: World3D, pose: Pose3) -> None:
    """Refuse a pose that no sensor can have.

    Raises:
        InputError: the pose is not finite or stands inside a solid or the ground.
    """
    if not pose.is_finite:
        raise InputError(f"{who}: the pose is not finite: {pose}")
    if world.contains(pose.translation[None, :])[0]:
        x, y, z = pose.translation
        raise InputError(
            f"{who}: the sensor at ({x:.3f}, {y:.3f}, {z:.3f}) stands inside an obstacle or the "
            "ground: move it to free space"
        )


def _check(lidar: Lidar3D) -> None:
    if lidar.ring_count < 1 or lidar.column_count < 1:
        raise ConfigError(
            "Lidar3D: ring_count and column_count must be at least 1, "
            f"got {lidar.ring_count} and {lidar.column_count}"
        )
    low, high = lidar.elevation_min, lidar.elevation_max
    if not -math.pi / 2 <= low <= high <= math.pi / 2:
        raise ConfigError(
            "Lidar3D: -pi/2 <= elevation_min <= elevation_max <= pi/2 must hold [rad], "
            f"got {low} and {high}"
        )
    if not (math.isfinite(lidar.range_max) and lidar.range_max > _SHORTEST):
        raise ConfigError(
            f"Lidar3D: range_max must be finite and above {_SHORTEST} m, got {lidar.range_max}"
        )
    if not (math.isfinite(lidar.sigma) and lidar.sigma >= 0):
        raise ConfigError(f"Lidar3D: sigma must be 0 m or more, got {lidar.sigma}")
