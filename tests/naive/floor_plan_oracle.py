# SPDX-License-Identifier: Apache-2.0
"""Ray casting and point location in plain Python, one ray and one edge at a time."""

from __future__ import annotations

import math
from fractions import Fraction

from oddsmap.simulate import Disc, FloorPlan, Polygon, Rectangle

Point = tuple[float, float]


def corners(shape: Rectangle | Polygon) -> list[Point]:
    if isinstance(shape, Polygon):
        return list(shape.points)
    x0, y0, x1, y1 = shape.x_min, shape.y_min, shape.x_max, shape.y_max
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def cast(plan: FloorPlan, origin: Point, direction: Point, slack: float) -> float:
    """Distance to the first surface, with every surface grown (slack > 0) or shrunk (< 0).

    A ray that only just touches may meet or miss in floating point: the exact answer for grown
    surfaces is a lower bound, that for shrunk ones an upper bound.
    """
    best = math.inf
    for shape in plan.obstacles:
        if isinstance(shape, Disc):
            best = min(best, _to_circle(shape, origin, direction, slack))
        else:
            ring = corners(shape)
            for i, start in enumerate(ring):
                best = min(best, _to_edge(start, ring[i - 1], origin, direction, slack))
    return best


def _to_edge(a: Point, b: Point, origin: Point, direction: Point, slack: float) -> float:
    ax, ay, bx, by, ox, oy, dx, dy = map(Fraction, (*a, *b, *origin, *direction))
    ex, ey = bx - ax, by - ay
    across = dx * ey - dy * ex
    if across == 0:
        return math.inf
    t = ((ax - ox) * ey - (ay - oy) * ex) / across
    u = ((ax - ox) * dy - (ay - oy) * dx) / across
    grown: Fraction = Fraction(slack)
    if t >= (-grown if slack > 0 else 0) and -grown <= u <= 1 + grown:
        return float(t)
    return math.inf


def _to_circle(disc: Disc, origin: Point, direction: Point, slack: float) -> float:
    radius = disc.radius + slack
    ox, oy = origin[0] - disc.x, origin[1] - disc.y
    # |o + t*d|^2 = radius^2 as a quadratic equation in t.
    a = direction[0] ** 2 + direction[1] ** 2
    b = 2 * (ox * direction[0] + oy * direction[1])
    c = ox**2 + oy**2 - radius**2
    root = b * b - 4 * a * c
    if root < 0:
        return math.inf
    for t in ((-b - math.sqrt(root)) / (2 * a), (-b + math.sqrt(root)) / (2 * a)):
        if t >= 0:
            return t
    return math.inf


def contains(plan: FloorPlan, point: Point) -> bool:
    """Whether the outline of any shape winds around the point (not for points on an outline)."""
    for shape in plan.obstacles:
        if isinstance(shape, Disc):
            if math.dist(point, (shape.x, shape.y)) < shape.radius:
                return True
        elif abs(_winding(corners(shape), point)) > math.pi:
            return True
    return False


def distance_to_obstacles(plan: FloorPlan, point: Point) -> float:
    """Distance to the nearest surface [m], for a point outside of all obstacles."""
    best = math.inf
    for shape in plan.obstacles:
        if isinstance(shape, Disc):
            best = min(best, math.dist(point, (shape.x, shape.y)) - shape.radius)
            continue
        ring = corners(shape)
        for i, a in enumerate(ring):
            b = ring[i - 1]
            ex, ey = b[0] - a[0], b[1] - a[1]
            u = ((point[0] - a[0]) * ex + (point[1] - a[1]) * ey) / (ex * ex + ey * ey)
            u = min(max(u, 0.0), 1.0)
            best = min(best, math.dist(point, (a[0] + u * ex, a[1] + u * ey)))
    return best


def _winding(ring: list[Point], point: Point) -> float:
    """Angle that the outline turns around the point [rad]: 0 outside, 2 pi inside."""
    total = 0.0
    for i, a in enumerate(ring):
        b = ring[i - 1]
        ax, ay, bx, by = a[0] - point[0], a[1] - point[1], b[0] - point[0], b[1] - point[1]
        total += math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    return total
