# SPDX-License-Identifier: Apache-2.0
"""Ray casting in space in plain Python: one ray, one face of one solid at a time."""

from __future__ import annotations

import math

from oddsmap.simulate import Box, Cylinder, Ground, Solid, World3D

Point = tuple[float, float, float]


def cast(world: World3D, origin: Point, direction: Point, slack: float, reach: float) -> float:
    """Distance to the first surface, with every face grown (slack > 0) or shrunk (< 0).

    A ray that only just touches may meet or miss in floating point: the answer for grown faces is
    a lower bound, that for shrunk ones an upper bound (up to rounding).
    """
    best = math.inf
    for solid in world.solids:
        faces = _box(solid, origin, direction) if isinstance(solid, Box) else _cylinder(
            solid, origin, direction
        )  # fmt: skip
        for t, outside in faces:
            if t >= 0 and outside <= slack:
                best = min(best, t)
    if world.ground is not None:
        best = min(best, _ground(world.ground, origin, direction, reach))
    return best if best <= reach else math.inf


def _box(box: Box, origin: Point, direction: Point) -> list[tuple[float, float]]:
    """(distance, how far the point is outside of the face) for each of the six planes."""
    c, s = math.cos(box.yaw), math.sin(box.yaw)
    x, y = origin[0] - box.x, origin[1] - box.y
    middle, half_height = (box.z_min + box.z_max) / 2, (box.z_max - box.z_min) / 2
    o = (c * x + s * y, c * y - s * x, origin[2] - middle)
    d = (
        c * direction[0] + s * direction[1],
        c * direction[1] - s * direction[0],
        direction[2],
    )
    half = (box.length / 2, box.width / 2, half_height)
    faces = []
    for axis in range(3):
        if d[axis] == 0:
            continue
        for side in (-1, 1):
            t = (side * half[axis] - o[axis]) / d[axis]
            others = [k for k in range(3) if k != axis]
            faces.append((t, max(abs(o[k] + t * d[k]) - half[k] for k in others)))
    return faces


def _cylinder(pole: Cylinder, origin: Point, direction: Point) -> list[tuple[float, float]]:
    x, y, z = origin[0] - pole.x, origin[1] - pole.y, origin[2]
    dx, dy, dz = direction
    faces = []
    if dz != 0:
        for end in (pole.z_min, pole.z_max):
            t = (end - z) / dz
            faces.append((t, math.hypot(x + t * dx, y + t * dy) - pole.radius))
    # |o + t*d|^2 = radius^2 seen from above, as a quadratic equation in t. A ray that passes just
    # beside the side has no root: it touches where it is nearest, so far outside.
    a, b, c = dx * dx + dy * dy, 2 * (x * dx + y * dy), x * x + y * y - pole.radius**2
    if a == 0:
        return faces
    nearest = math.hypot(x - b / (2 * a) * dx, y - b / (2 * a) * dy)
    root = math.sqrt(max(b * b - 4 * a * c, 0.0))
    for t in ((-b - root) / (2 * a), (-b + root) / (2 * a)):
        over = max(pole.z_min - (z + t * dz), z + t * dz - pole.z_max)
        # A ray that nearly touches is as doubtful as one that nearly misses.
        faces.append((t, max(over, nearest - pole.radius)))
    return faces


def _ground(ground: Ground, origin: Point, direction: Point, reach: float) -> float:
    """First change of sign in steps of 1 cm, halved until it is found to 1e-12 m."""

    def above(t: float) -> float:
        x, y, z = (o + t * d for o, d in zip(origin, direction, strict=True))
        return z - height(ground, x, y)

    if above(0.0) <= 0:
        return 0.0
    t, step = 0.0, 0.01
    while t < min(reach, 200.0):
        if above(t + step) <= 0:
            low, high = t, t + step
            for _ in range(40):
                middle = (low + high) / 2
                low, high = (low, middle) if above(middle) <= 0 else (middle, high)
            return high
        t += step
    return math.inf


def height(ground: Ground, x: float, y: float) -> float:
    return ground.z + sum(a * math.sin(kx * x + ky * y + p) for a, kx, ky, p in ground.waves)


def contains(world: World3D, point: Point) -> bool:
    x, y, z = point
    if world.ground is not None and z < height(world.ground, x, y):
        return True
    return any(_inside(solid, x, y, z) for solid in world.solids)


def _inside(solid: Solid, x: float, y: float, z: float) -> bool:
    if not solid.z_min < z < solid.z_max:
        return False
    if isinstance(solid, Cylinder):
        return math.dist((x, y), (solid.x, solid.y)) < solid.radius
    turned = complex(x - solid.x, y - solid.y) * complex(math.cos(solid.yaw), -math.sin(solid.yaw))
    return abs(turned.real) < solid.length / 2 and abs(turned.imag) < solid.width / 2
