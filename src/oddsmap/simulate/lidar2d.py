# SPDX-License-Identifier: Apache-2.0
"""A scanning 2D lidar, with noise, dropouts and random readings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose2
from oddsmap.scans.scan import Scan
from oddsmap.simulate.floor_plan import FloorPlan

__all__ = ["Lidar2D"]

# No reading is shorter [m]: noise in front of a close wall gives no zero or negative range.
_SHORTEST = 1e-3


@dataclass(frozen=True, slots=True)
class Lidar2D:
    """A fan of beams, and the chances of what each of them reads.

    Each beam on its own draws one of three cases:

    - with `p_dropout`: no return, +Inf;
    - with `p_random`: a reading uniform between 0 and `range_max`, whatever stands there;
    - else: the distance to the first surface plus Gaussian noise of `sigma`; +Inf where that
      surface is at `range_max` or beyond, or the noise takes the reading there.

    No reading is below 1 mm: shorter ones become 1 mm.

    Args:
        beam_count: beams in a scan.
        angle_min: angle of beam 0 from the sensor's x axis [rad].
        angle_step: angle from one beam to the next [rad], anticlockwise.
        range_max: every reading is below it, or +Inf [m].
        sigma: standard deviation of the noise [m].
        p_dropout: probability of no return.
        p_random: probability of a random reading.

    Raises:
        ConfigError: a parameter outside its range, or probabilities that add up to more than 1.

    Source:
        Thrun, Burgard and Fox, Probabilistic Robotics (2005), section 6.3, without the
        unexpected objects: here the world is the plan.
    """

    beam_count: int = 180
    angle_min: float = -math.pi / 2
    angle_step: float = math.pi / 180
    range_max: float = 30.0
    sigma: float = 0.01
    p_dropout: float = 0.0
    p_random: float = 0.0
    directions: npt.NDArray[np.float64] = field(init=False, repr=False, compare=False)
    """Unit vectors in the sensor frame, shape (beam_count, 2), shared by all scans."""

    def __post_init__(self) -> None:
        _check(self)
        angles = self.angle_min + self.angle_step * np.arange(self.beam_count)
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        directions.flags.writeable = False
        object.__setattr__(self, "directions", directions)

    def scan(
        self,
        plan: FloorPlan,
        pose: Pose2,
        rng: np.random.Generator,
        *,
        stamp_ns: int | None = None,
    ) -> Scan:
        """Take one scan.

        The same generator state gives the same scan. Three numbers are drawn for each beam
        whatever it reads, so that a beam keeps its noise when a probability is changed.

        Args:
            plan: what stands where, in the map frame.
            pose: of the sensor in the map frame.
            rng: where the chance comes from.
            stamp_ns: time of the scan [ns], handed on.

        Returns:
            The scan, ranges [m], shape (beam_count,), +Inf = no return.

        Raises:
            InputError: the pose is not finite or stands inside an obstacle.
        """
        if not pose.is_finite:
            raise InputError(f"Lidar2D.scan: the pose is not finite: {pose}")
        origin = pose.translation
        if plan.contains(origin[None, :])[0]:
            raise InputError(
                f"Lidar2D.scan: the sensor at ({pose.x:.3f}, {pose.y:.3f}) stands inside an "
                "obstacle: move it to free space"
            )
        true_ranges = plan.cast(origin, self.directions @ pose.rotation.T)
        case = rng.random(self.beam_count)
        anything = self.range_max * rng.random(self.beam_count)
        noise = self.sigma * rng.standard_normal(self.beam_count)

        ranges = np.where(true_ranges < self.range_max, true_ranges + noise, np.inf)
        ranges[ranges >= self.range_max] = np.inf
        ranges = np.where(case < self.p_dropout + self.p_random, anything, ranges)
        ranges = np.where(case < self.p_dropout, np.inf, ranges)
        return Scan(pose, self.directions, np.maximum(ranges, _SHORTEST), stamp_ns, trusted=True)


def _check(lidar: Lidar2D) -> None:
    if lidar.beam_count < 1:
        raise ConfigError(f"Lidar2D: beam_count must be at least 1, got {lidar.beam_count}")
    if not (math.isfinite(lidar.angle_min) and math.isfinite(lidar.angle_step)):
        raise ConfigError(
            "Lidar2D: angle_min and angle_step must be finite [rad], "
            f"got {lidar.angle_min} and {lidar.angle_step}"
        )
    if not (math.isfinite(lidar.range_max) and lidar.range_max > _SHORTEST):
        raise ConfigError(
            f"Lidar2D: range_max must be finite and above {_SHORTEST} m, got {lidar.range_max}"
        )
    if not (math.isfinite(lidar.sigma) and lidar.sigma >= 0):
        raise ConfigError(f"Lidar2D: sigma must be 0 m or more, got {lidar.sigma}")
    for name, p in (("p_dropout", lidar.p_dropout), ("p_random", lidar.p_random)):
        if not 0 <= p <= 1:
            raise ConfigError(f"Lidar2D: {name} must be in [0, 1], got {p}")
    if lidar.p_dropout + lidar.p_random > 1:
        raise ConfigError(
            "Lidar2D: p_dropout + p_random must not exceed 1, "
            f"got {lidar.p_dropout} + {lidar.p_random}"
        )
