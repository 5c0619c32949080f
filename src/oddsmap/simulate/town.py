# SPDX-License-Identifier: Apache-2.0
"""A street that runs in a loop: buildings on both sides, crates, poles and trees, by chance."""

from __future__ import annotations

import math

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError
from oddsmap.poses.pose import Pose3
from oddsmap.simulate.solids import Box, Cylinder, Ground, Solid
from oddsmap.simulate.world3d import World3D

__all__ = ["drive3d", "on_lane", "town"]


# The middle of the street: an ellipse around (0, 0) with these half axes [m], 152 m long.
_HALF_AXES = np.array([30.0, 17.0])

# Nothing stands nearer to the middle of the street than this [m].
_FREE = 2.5

# (amplitude [m], wavelength [m]) of the relief: no slope is steeper than 7 degrees.
_RELIEF = ((0.35, 60.0), (0.15, 25.0), (0.05, 9.0))

_POLES, _TREES, _CRATES = 24, 14, 24


def town(seed: int = 0, *, flat: bool = False) -> World3D:
    """Some 100 solids along the street of `drive3d`.

    Args:
        seed: another number, another town; the street stays.
        flat: True for a level ground at z = 0, False for a gentle relief.

    Returns:
        The world; within 2.5 m of the middle of the street there is nothing but ground.
    """
    rng = np.random.default_rng(seed)
    ground = Ground() if flat else _relief(rng)
    solids: list[Solid] = [*_row(rng, ground, 1), *_row(rng, ground, -1)]
    solids += [_pole(rng, ground) for _ in range(_POLES)]
    solids += [part for _ in range(_TREES) for part in _tree(rng, ground)]
    solids += [_crate(rng, ground) for _ in range(_CRATES)]
    return World3D((s for s in solids if _clear_of_street(s)), ground)


def drive3d(
    pose_count: int = 100, *, ground: Ground | None = None, height: float = 1.8
) -> tuple[Pose3, ...]:
    """Poses of a sensor on a car that goes once around the street.

    Args:
        pose_count: poses, equally far apart along the way (1.5 m for 100).
        ground: what the car drives on; by default level at z = 0.
        height: of the sensor above the ground [m].

    Returns:
        map_from_sensor of each pose: x forward, z up, rolling and pitching by up to 2 degrees.

    Raises:
        ConfigError: no pose, or a height that is not above 0.
    """
    if pose_count < 1 or not height > 0:
        raise ConfigError(
            "drive3d: pose_count must be at least 1 and height above 0 m, "
            f"got {pose_count} and {height}"
        )
    ground = ground or Ground()
    poses = []
    # A third of a step off, so that no pose lies on a border of cells and looks along it.
    for i, angle in enumerate(_angles((np.arange(pose_count) + 1 / 3) / pose_count)):
        x, y = _on_street(angle)
        yaw = _heading(angle)
        pitch, roll = math.radians(2) * math.sin(0.7 * i), math.radians(2) * math.cos(1.1 * i)
        z = _height(ground, x, y) + height
        poses.append(Pose3(np.array([x, y, z]), _rotation(yaw, pitch, roll)))
    return tuple(poses)


# ---- the street ------------------------------------------------------------------------------


def _on_street(angle: float) -> tuple[float, float]:
    return float(_HALF_AXES[0] * math.cos(angle)), float(_HALF_AXES[1] * math.sin(angle))


def _heading(angle: float) -> float:
    a, b = _HALF_AXES
    return math.atan2(b * math.cos(angle), -a * math.sin(angle))


def _angles(shares: FloatArray) -> FloatArray:
    """Parameters of the ellipse at shares of its length."""
    angle = np.linspace(0.0, 2 * math.pi, 4097)
    steps = np.hypot(*(_HALF_AXES[:, None] * np.diff([np.cos(angle), np.sin(angle)], axis=1)))
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    return np.interp(shares % 1.0, travelled / travelled[-1], angle)


def _beside_street(angle: float, offset: float) -> tuple[float, float]:
    """The point that many metres to the right of the street: outside of the loop."""
    (x, y), yaw = _on_street(angle), _heading(angle)
    return x + offset * math.sin(yaw), y - offset * math.cos(yaw)


def on_lane(shares: FloatArray, offsets: FloatArray) -> FloatArray:
    """Points along the street.

    Args:
        shares: of its length, from where `drive3d` starts, shape (n,).
        offsets: how far to the right of its middle [m], shape (n,).

    Returns:
        x and y [m], shape (n, 2).
    """
    angles = _angles(np.asarray(shares, np.float64))
    places = zip(angles.tolist(), offsets.tolist(), strict=True)
    return np.array([_beside_street(angle, offset) for angle, offset in places])


def _clear_of_street(solid: Solid) -> bool:
    angle = np.linspace(0.0, 2 * math.pi, 1024)
    x, y = _HALF_AXES[0] * np.cos(angle) - solid.x, _HALF_AXES[1] * np.sin(angle) - solid.y
    if isinstance(solid, Cylinder):
        gap = np.hypot(x, y) - solid.radius
    else:
        c, s = math.cos(solid.yaw), math.sin(solid.yaw)
        along = np.maximum(np.abs(c * x + s * y) - solid.length / 2, 0.0)
        gap = np.hypot(along, np.maximum(np.abs(c * y - s * x) - solid.width / 2, 0.0))
    return bool(gap.min() >= _FREE)


def _rotation(yaw: float, pitch: float, roll: float) -> FloatArray:
    (cy, sy), (cp, sp), (cr, sr) = ((math.cos(v), math.sin(v)) for v in (yaw, pitch, roll))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


# ---- what stands beside it -------------------------------------------------------------------


def _relief(rng: np.random.Generator) -> Ground:
    waves = []
    for amplitude, length in _RELIEF:
        way, phase = rng.uniform(0.0, 2 * math.pi, 2)
        k = 2 * math.pi / length
        waves.append((amplitude, k * math.cos(way), k * math.sin(way), float(phase)))
    return Ground(waves=tuple(waves))


def _height(ground: Ground, x: float, y: float) -> float:
    return float(ground.height(np.array([x]), np.array([y]))[0])


def _row(rng: np.random.Generator, ground: Ground, side: int) -> list[Box]:
    """Buildings on one side (1 right, -1 left), most with a face along the street."""
    street = 152.0
    houses, travelled = [], 0.0
    while travelled < street:
        length, width = rng.uniform(7.0, 15.0), rng.uniform(6.0, 10.0)
        angle = float(_angles(np.array([(travelled + length / 2) / street]))[0])
        x, y = _beside_street(angle, side * (rng.uniform(5.0, 8.0) + width / 2))
        yaw = _heading(angle) + rng.normal(0.0, 0.05) if rng.random() < 0.7 else 0.0
        top = rng.uniform(6.0, 14.0)
        base = _height(ground, x, y)
        houses.append(Box(x, y, length, width, base - 2.0, base + top, yaw))
        travelled += length + rng.uniform(0.0, 3.0)
    return houses


def _somewhere(rng: np.random.Generator, nearest: float, farthest: float) -> tuple[float, float]:
    angle = float(_angles(rng.random(1))[0])
    return _beside_street(angle, float(rng.choice([-1, 1]) * rng.uniform(nearest, farthest)))


def _pole(rng: np.random.Generator, ground: Ground) -> Cylinder:
    x, y = _somewhere(rng, 3.5, 5.0)
    base = _height(ground, x, y)
    return Cylinder(x, y, rng.uniform(0.04, 0.12), base - 0.5, base + rng.uniform(3.0, 7.0))


def _tree(rng: np.random.Generator, ground: Ground) -> tuple[Cylinder, Cylinder]:
    x, y = _somewhere(rng, 4.0, 6.0)
    base, trunk = _height(ground, x, y), rng.uniform(1.8, 2.8)
    stem = Cylinder(x, y, rng.uniform(0.12, 0.3), base - 0.5, base + trunk)
    crown = Cylinder(x, y, rng.uniform(0.8, 1.4), base + trunk, base + trunk + rng.uniform(1, 3))
    return stem, crown


def _crate(rng: np.random.Generator, ground: Ground) -> Box:
    x, y = _somewhere(rng, 3.0, 6.0)
    length, width, top = rng.uniform(0.4, 1.6, 3)
    yaw = rng.uniform(0.0, math.pi) if rng.random() < 0.7 else 0.0
    base = _height(ground, x, y)
    return Box(x, y, length, width, base - 0.3, base + top, float(yaw))
