# SPDX-License-Identifier: Apache-2.0
"""A furnished room of 6.4 x 5 x 2.6 m, and a camera that is carried through it."""

from __future__ import annotations

import math

import numpy as np

from oddsmap.errors import ConfigError
from oddsmap.poses.pose import Pose3
from oddsmap.simulate.solids import Box, Cylinder, Ground, Solid
from oddsmap.simulate.world3d import World3D

__all__ = ["room", "room_walk"]

_LEGS = ((-0.75, -0.35), (-0.75, 0.35), (0.75, -0.35), (0.75, 0.35))

# x, y, length, width, z_min, z_max, yaw. No symmetry maps the room onto itself.
_BOXES = (
    # Walls around (-3.2, -2.5) to (3.2, 2.5), with a doorway in the east; the ceiling.
    Box(-3.3, 0.0, 0.2, 5.4, 0.0, 2.6), Box(0.0, -2.6, 6.8, 0.2, 0.0, 2.6),
    Box(0.0, 2.6, 6.8, 0.2, 0.0, 2.6), Box(3.3, -1.0, 0.2, 3.4, 0.0, 2.6),
    Box(3.3, 2.1, 0.2, 1.0, 0.0, 2.6), Box(0.0, 0.0, 6.8, 5.4, 2.6, 2.8),
    # What the doorway shows.
    Box(5.6, 0.8, 0.2, 6.0, 0.0, 2.6),
    # A table in the middle and what is on it, a desk, a shelf, a bed, a cupboard, boxes, a beam.
    Box(0.2, 0.1, 1.7, 0.9, 0.71, 0.75, 0.3), Box(0.5, 0.1, 0.3, 0.2, 0.75, 0.95, 1.0),
    Box(-2.2, 2.1, 1.6, 0.7, 0.70, 0.74), Box(-2.9, 2.1, 0.05, 0.7, 0.0, 0.70),
    Box(-1.5, 2.1, 0.05, 0.7, 0.0, 0.70), Box(-2.2, 2.3, 0.6, 0.05, 0.85, 1.25),
    Box(1.2, 2.3, 1.8, 0.3, 0.0, 1.9), Box(-2.2, -1.6, 2.0, 1.6, 0.0, 0.5),
    Box(1.9, -2.2, 1.2, 0.55, 0.0, 2.1), Box(2.8, -0.6, 0.5, 0.4, 0.0, 0.45, 0.5),
    Box(2.75, -0.5, 0.3, 0.3, 0.45, 0.7, 0.9), Box(0.0, 0.9, 6.4, 0.2, 2.4, 2.6),
)  # fmt: skip


def room() -> World3D:
    """The room: walls, a doorway, a ceiling, furniture with thin legs, a lamp, a column."""
    c, s = math.cos(0.3), math.sin(0.3)
    things: list[Solid] = [*_BOXES]
    things += [Cylinder(0.2 + c * x - s * y, 0.1 + s * x + c * y, 0.025, 0, 0.71) for x, y in _LEGS]
    things += [Cylinder(-2.9, -0.4, 0.15, 0.0, 2.6), Cylinder(-0.3, -2.2, 0.02, 0.0, 1.6)]
    things += [Cylinder(-0.3, -2.2, 0.18, 1.6, 1.9), Cylinder(0.2, 0.1, 0.15, 2.0, 2.3)]
    return World3D(things, Ground())


def room_walk(pose_count: int = 60) -> tuple[Pose3, ...]:
    """Poses of a camera carried once around the table, looking outwards and across in turn.

    Args:
        pose_count: poses.

    Returns:
        map_from_sensor of each pose: z forward, x right, y down, 1.2 to 1.6 m above the floor.

    Raises:
        ConfigError: no pose.
    """
    if pose_count < 1:
        raise ConfigError(f"room_walk: pose_count must be at least 1, got {pose_count}")
    poses = []
    for share in np.arange(pose_count) / pose_count:
        angle = 2 * math.pi * share
        position = np.array([1.5 * math.cos(angle), 1.3 * math.sin(angle), 1.4])
        position[2] += 0.2 * math.sin(3 * angle)
        yaw = angle + 2.6 * math.sin(5 * angle)
        down = math.radians(12) + math.radians(14) * math.sin(7 * angle)
        ahead = np.array([math.cos(yaw) * math.cos(down), math.sin(yaw) * math.cos(down),
                          -math.sin(down)])  # fmt: skip
        right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
        poses.append(Pose3(position, np.stack([right, np.cross(ahead, right), ahead], axis=1)))
    return tuple(poses)
