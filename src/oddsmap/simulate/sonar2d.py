# SPDX-License-Identifier: Apache-2.0
"""A ring of sonars in 2D: the nearest surface in each cone, with noise and faults.

Readings come from the true geometry of a grid, not from a sensor model of range bins, so that an
estimator is not tried on its own assumptions. Readings drawn from the model itself are
`oddsmap.forward.model.ForwardModel.simulate`'s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose2
from oddsmap.scans.scan import Scan

__all__ = ["Sonar2D", "nearest_in_cones"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sonar2D:
    """A ring of sonars, the first along the x axis of the robot, the others anticlockwise.

    Each beam on its own draws one of three cases: with `p_dropout` no return, +Inf; with
    `p_random` a reading uniform between 0 and `range_max`; else the distance to the nearest point
    of an occupied cell inside its cone plus Gaussian noise, +Inf from `range_max` on, and 0 where
    noise would take it below.

    Args:
        beam_count: sonars in the ring.
        cone_deg: full opening angle of each [deg], above 0 and up to 180.
        range_max: every reading is below it, or +Inf [m].
        sigma: standard deviation of the noise [m].
        p_random: probability of a random reading.
        p_dropout: probability of no return.

    Raises:
        ConfigError: a parameter outside its range.
    """

    beam_count: int = 24
    cone_deg: float = 25.0
    range_max: float = 4.0
    sigma: float = 0.03
    p_random: float = 0.0
    p_dropout: float = 0.0

    def __post_init__(self) -> None:
        if self.beam_count < 1:
            raise ConfigError(f"Sonar2D: beam_count is 1 or more, got {self.beam_count}")
        if not 0.0 < self.cone_deg <= 180.0:
            raise ConfigError(f"Sonar2D: cone_deg lies above 0 and up to 180, got {self.cone_deg}")
        if not 0.0 < self.range_max < math.inf:
            raise ConfigError(f"Sonar2D: range_max is a length above 0 m, got {self.range_max}")
        if not 0.0 <= self.sigma < math.inf:
            raise ConfigError(f"Sonar2D: sigma is a length of 0 m or more, got {self.sigma}")
        if not (min(self.p_random, self.p_dropout) >= 0 and self.p_random + self.p_dropout <= 1):
            raise ConfigError(
                "Sonar2D: p_random and p_dropout are 0 or more and add up to 1 at most, got "
                f"{self.p_random} and {self.p_dropout}"
            )

    @property
    def directions(self) -> FloatArray:
        """Unit vectors in the sensor frame, shape (beam_count, 2)."""
        angles = 2.0 * math.pi / self.beam_count * np.arange(self.beam_count)
        return np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def scan(
        self,
        truth: BoolArray,
        resolution: float,
        pose: Pose2,
        rng: np.random.Generator,
        *,
        stamp_ns: int | None = None,
    ) -> Scan:
        """Take one scan; the same generator state gives the same scan.

        Args:
            truth: True where a cell is occupied, shape (ny, nx), cell (0, 0) at the map's origin.
            resolution: side of a cell [m].
            pose: of the sensor in the map frame.
            rng: where the chance comes from.
            stamp_ns: time of the scan [ns], handed on.

        Returns:
            The scan, ranges [m], shape (beam_count,).

        Raises:
            InputError: truth is no grid, or the pose is not finite or in an occupied cell.
        """
        if truth.ndim != 2 or not 0.0 < resolution < math.inf:
            raise InputError(
                f"Sonar2D.scan: truth is a grid (ny, nx) of cells above 0 m, got shape "
                f"{truth.shape} and {resolution} m"
            )
        if not pose.is_finite:
            raise InputError(f"Sonar2D.scan: the pose is not finite: {pose}")
        directions = self.directions
        exact = nearest_in_cones(
            truth,
            resolution,
            pose.translation,
            directions @ pose.rotation.T,
            math.radians(self.cone_deg) / 2,
            self.range_max,
        )
        case, place = rng.random((2, self.beam_count))
        ranges = np.maximum(exact + self.sigma * rng.standard_normal(self.beam_count), 0.0)
        ranges[ranges >= self.range_max] = np.inf
        ranges = np.where(case < self.p_dropout + self.p_random, self.range_max * place, ranges)
        ranges = np.where(case < self.p_dropout, np.inf, ranges)
        return Scan(pose, directions, ranges, stamp_ns)


def nearest_in_cones(
    truth: BoolArray,
    resolution: float,
    origin: FloatArray,
    axes: FloatArray,
    half_angle: float,
    range_max: float,
) -> FloatArray:
    """Distance to the nearest point of an occupied cell inside each cone.

    Args:
        truth: True where a cell is occupied, shape (ny, nx).
        resolution: side of a cell [m].
        origin: where the cones start [m], shape (2,).
        axes: unit vectors along their axes, shape (n, 2).
        half_angle: half their opening angle [rad], up to pi / 2.
        range_max: cells further off are not looked at [m].

    Returns:
        Distances [m], shape (n,), +Inf where there is nothing.

    Raises:
        InputError: the origin lies in an occupied cell.
    """
    row, column = np.nonzero(truth)
    low = np.stack([column, row], axis=1) * resolution - origin
    high = low + resolution
    nearest = np.clip(0.0, low, high)
    distance = np.hypot(nearest[:, 0], nearest[:, 1])
    if ((low <= 0.0) & (high > 0.0)).all(axis=1).any():
        raise InputError(
            f"the sonar at ({origin[0]:.3f}, {origin[1]:.3f}) stands in an occupied cell: "
            "move it to free space"
        )
    close = distance < range_max
    low, high, nearest, distance = low[close], high[close], nearest[close], distance[close]
    found = np.full(len(axes), np.inf)
    # A cell is convex and so is a cone: where a cell's nearest point lies beside the cone, the
    # nearest one inside is on a side of the cone.
    c, s = math.cos(half_angle), math.sin(half_angle)
    for i, (ax, ay) in enumerate(axes):
        inside = (nearest @ (ax, ay) >= c * distance) & (distance > 0.0)
        found[i] = distance[inside].min(initial=np.inf)
        for turn in (-s, s):
            ray = np.array([c * ax - turn * ay, c * ay + turn * ax])
            found[i] = min(found[i], _cast(low, high, ray))
    return found


def _cast(low: FloatArray, high: FloatArray, ray: FloatArray) -> float:
    # First entry of a ray from the origin into any of some boxes.
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = low / ray, high / ray
    enter = np.fmax.reduce(np.fmin(one, other), axis=1)
    leave = np.fmin.reduce(np.fmax(one, other), axis=1)
    return float(enter[(enter >= 0.0) & (enter <= leave)].min(initial=np.inf))
