# SPDX-License-Identifier: Apache-2.0
"""The solid things a world is made of: upright boxes and cylinders, and the ground, in metres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError

__all__ = ["Box", "Cylinder", "Ground", "Solid"]


@dataclass(frozen=True, slots=True)
class Box:
    """An upright box: a building, a crate, a wall, a table top.

    Args:
        x: of its centre [m].
        y: of its centre [m].
        length: along its own x axis [m].
        width: along its own y axis [m].
        z_min: lower face [m].
        z_max: upper face [m].
        yaw: from the map's x axis to its own, anticlockwise [rad].

    Raises:
        InputError: a number is not finite, or a side is not positive.
    """

    x: float
    y: float
    length: float
    width: float
    z_min: float
    z_max: float
    yaw: float = 0.0

    def __post_init__(self) -> None:
        numbers = (self.x, self.y, self.length, self.width, self.z_min, self.z_max, self.yaw)
        if not all(map(math.isfinite, numbers)):
            raise InputError(f"Box: every number must be finite, got {numbers}")
        if not (self.length > 0 and self.width > 0 and self.z_min < self.z_max):
            raise InputError(
                "Box: length and width must be positive and z_max above z_min, got "
                f"{self.length} x {self.width} m from {self.z_min} to {self.z_max} m"
            )

    @property
    def radius(self) -> float:
        """Of the circle around its outline [m]."""
        return math.hypot(self.length, self.width) / 2

    def outline_interval(self, o: FloatArray, d: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where rays, seen from above, enter and leave the outline [m along the ray].

        Args:
            o: where the rays start, shape (n, 2) or (1, 2).
            d: directions, shape (n, 2), not of unit length.

        Returns:
            Two arrays, shape (n,); enter > leave where the outline is missed.
        """
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        x, y = o[:, 0] - self.x, o[:, 1] - self.y
        in_x = _between(c * x + s * y, c * d[:, 0] + s * d[:, 1], self.length / 2)
        in_y = _between(c * y - s * x, c * d[:, 1] - s * d[:, 0], self.width / 2)
        return np.maximum(in_x[0], in_y[0]), np.minimum(in_x[1], in_y[1])

    def outline_contains(self, p: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether points, shape (n, 2), are in the outline seen from above."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        x, y = p[:, 0] - self.x, p[:, 1] - self.y
        in_x = np.abs(c * x + s * y) < self.length / 2
        return np.asarray(in_x & (np.abs(c * y - s * x) < self.width / 2))


@dataclass(frozen=True, slots=True)
class Cylinder:
    """An upright cylinder with flat ends: a pole, a trunk, a barrel.

    Args:
        x: of its axis [m].
        y: of its axis [m].
        radius: [m].
        z_min: lower end [m].
        z_max: upper end [m].

    Raises:
        InputError: a number is not finite, or radius or height are not positive.
    """

    x: float
    y: float
    radius: float
    z_min: float
    z_max: float

    def __post_init__(self) -> None:
        numbers = (self.x, self.y, self.radius, self.z_min, self.z_max)
        if not all(map(math.isfinite, numbers)):
            raise InputError(f"Cylinder: every number must be finite, got {numbers}")
        if not (self.radius > 0 and self.z_min < self.z_max):
            raise InputError(
                "Cylinder: the radius must be positive and z_max above z_min, got "
                f"{self.radius} m from {self.z_min} to {self.z_max} m"
            )

    def outline_interval(self, o: FloatArray, d: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where rays, seen from above, enter and leave the outline: see `Box`."""
        x, y = o[:, 0] - self.x, o[:, 1] - self.y
        a = d[:, 0] ** 2 + d[:, 1] ** 2
        along = -(x * d[:, 0] + y * d[:, 1])
        across = x * d[:, 1] - y * d[:, 0]
        room = a * self.radius**2 - across**2
        half = np.sqrt(np.maximum(room, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            enter, leave = (along - half) / a, (along + half) / a
        upright = a == 0.0
        inside = x**2 + y**2 <= self.radius**2
        met = np.where(upright, inside, room >= 0.0)
        enter = np.where(met, np.where(upright, -np.inf, enter), np.inf)
        leave = np.where(met, np.where(upright, np.inf, leave), -np.inf)
        return enter, leave

    def outline_contains(self, p: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether points, shape (n, 2), are in the outline seen from above."""
        return np.asarray(np.hypot(p[:, 0] - self.x, p[:, 1] - self.y) < self.radius)


Solid = Box | Cylinder


@dataclass(frozen=True, slots=True)
class Ground:
    """Everything below a surface: flat, or with a gentle relief of plane waves.

    Height: z + sum of amplitude * sin(kx * x + ky * y + phase).

    Args:
        z: mean height [m].
        waves: (amplitude [m], kx [rad/m], ky [rad/m], phase [rad]) of each wave.

    Raises:
        InputError: a number is not finite, or the slope may pass 1 (45 degrees).
    """

    z: float = 0.0
    waves: tuple[tuple[float, float, float, float], ...] = ()

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.z, *(v for wave in self.waves for v in wave)))):
            raise InputError(f"Ground: every number must be finite, got {self}")
        if self.steepest >= 1.0:
            raise InputError(f"Ground: the relief is gentle, its slope may be {self.steepest:.3g}")

    @property
    def steepest(self) -> float:
        """No slope is steeper than this [m/m]."""
        return sum(abs(a) * math.hypot(kx, ky) for a, kx, ky, _ in self.waves)

    @property
    def relief(self) -> float:
        """The surface stays within z - relief and z + relief [m]."""
        return sum(abs(wave[0]) for wave in self.waves)

    def height(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Height of the surface [m]."""
        z = np.full(np.broadcast_shapes(np.shape(x), np.shape(y)), self.z)
        for amplitude, kx, ky, phase in self.waves:
            z += amplitude * np.sin(kx * x + ky * y + phase)
        return z


def _between(x: FloatArray, dx: FloatArray, half: float) -> tuple[FloatArray, FloatArray]:
    """The interval of t in which |x + t * dx| <= half."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (-half - x) / dx, (half - x) / dx
    low, high = np.minimum(one, other), np.maximum(one, other)
    # dx = 0: always between the two sides, or never; 0/0 on a side itself counts as between.
    still = dx == 0.0
    if still.any():
        between = np.abs(x) <= half
        low = np.where(still, np.where(between, -np.inf, np.inf), low)
        high = np.where(still, np.where(between, np.inf, -np.inf), high)
    return low, high
