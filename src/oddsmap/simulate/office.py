# SPDX-License-Identifier: Apache-2.0
"""An office of 20 x 14 m and a drive through all of its rooms.

Faces along the axes lie 0.08 m beyond a multiple of 0.1 m, seen from within the solid: never on
the border of a cell of 0.05 or 0.1 m, and the cell that holds the face has its centre in the
solid. So an exact reading marks a cell that is occupied in the true grid as well.

No symmetry maps the plan onto itself, so that a map that is mirrored, turned or
transposed by mistake cannot pass for right.
"""

from __future__ import annotations

import math

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError
from oddsmap.poses.pose import Pose2
from oddsmap.simulate.floor_plan import FloorPlan
from oddsmap.simulate.shapes import Disc, Polygon, Rectangle, Shape, walls_around

__all__ = ["office_drive", "office_plan"]


_WALL = 0.16

# (x0, y0, x1, y1): centre lines of the inner walls [m]; a door is 0.16 m narrower than its gap.
_INNER_WALLS = (
    # South of the corridor: doors of 0.94, 1.04 and 1.84 m.
    (0.0, 6.0, 3.7, 6.0), (4.8, 6.0, 6.1, 6.0), (7.3, 6.0, 14.3, 6.0), (16.3, 6.0, 20.0, 6.0),
    # North of the corridor: doors of 0.84 and 1.04 m.
    (0.0, 8.0, 2.5, 8.0), (3.5, 8.0, 7.5, 8.0), (8.7, 8.0, 13.5, 8.0),
    # Between the rooms in the south; the second with a passage of 0.94 m.
    (5.5, 0.0, 5.5, 6.0), (11.0, 0.0, 11.0, 1.4), (11.0, 2.5, 11.0, 6.0),
    # Between the rooms in the north; the second with the kitchen's door, 1.14 m.
    (9.4, 8.0, 9.4, 14.0), (13.5, 8.0, 13.5, 11.1), (13.5, 12.4, 13.5, 14.0),
)  # fmt: skip
# Slanted on purpose: surfaces along no axis, and rooms that are no rectangles.
_SLANTED_WALL = Polygon([(4.1, 8.0), (4.26, 8.0), (5.66, 14.0), (5.5, 14.0)])
_CUT_CORNER = Polygon([(16.4, 14.0), (20.0, 10.7), (20.0, 14.0)])

_FURNITURE: tuple[Shape, ...] = (
    # South-west office: two desks in the middle, a shelf.
    Rectangle(1.62, 2.32, 3.48, 3.98), Rectangle(0.02, 0.02, 0.48, 1.88),
    # South office: a desk in the corner, another, a round table.
    Rectangle(5.52, 0.02, 6.38, 1.28), Rectangle(8.42, 3.72, 10.18, 4.58), Disc(9.13, 1.0, 0.45),
    # Hall in the south-east: desks, a column, cupboards.
    Rectangle(12.22, 3.42, 13.88, 4.88), Rectangle(17.32, 1.42, 18.18, 4.28),
    Disc(15.3, 2.9, 0.3), Rectangle(18.72, 0.02, 19.98, 0.58), Rectangle(12.42, 0.02, 14.28, 0.68),
    # North-west office: a desk around the corner.
    Polygon([(0.02, 11.72), (0.88, 11.72), (0.88, 13.12), (2.28, 13.12), (2.28, 13.98),
             (0.02, 13.98)]),
    # Meeting room: a table with cut corners, a sideboard.
    Polygon([(6.82, 10.52), (7.78, 10.52), (8.08, 10.88), (8.08, 12.22), (7.78, 12.58),
             (6.82, 12.58), (6.52, 12.22), (6.52, 10.88)]),
    Rectangle(8.92, 12.12, 9.38, 13.98),
    # Kitchen: a counter and a standing table.
    Rectangle(9.42, 13.32, 12.18, 13.98), Disc(11.33, 10.2, 0.4),
    # Lobby: a column, the reception, a sofa.
    Disc(16.5, 9.7, 0.35),
    Polygon([(18.12, 7.22), (18.78, 7.22), (18.78, 9.12), (19.98, 9.12), (19.98, 9.68),
             (18.12, 9.68)]),
    Rectangle(13.52, 8.92, 14.28, 10.68),
)  # fmt: skip

# The way [m]: straight lines between these points, with the corners rounded.
_WAY = (
    (0.9, 7.0), (4.25, 7.0), (4.25, 4.9),  # corridor, into the south-west office
    (4.5, 1.3), (1.1, 1.5), (1.0, 4.9), (4.25, 4.9), (4.25, 7.0),  # around its desks, out again
    (6.7, 7.0), (6.7, 3.1), (7.5, 1.95), (12.6, 1.95),  # south office, passage to the hall
    (14.3, 1.5), (16.3, 1.6), (16.4, 4.6), (15.3, 4.9),  # around the column
    (15.3, 8.5), (15.0, 11.75), (10.4, 11.75), (10.2, 9.2), (12.5, 9.2), (12.5, 11.75),  # kitchen
    (15.4, 11.75), (17.6, 10.6), (17.4, 7.0),  # lobby, past the cut corner
    (8.1, 7.0), (8.1, 9.6), (5.6, 9.6), (6.0, 13.2), (8.5, 13.2), (8.5, 9.6), (8.1, 7.0),  # meeting
    (3.0, 7.0), (3.0, 9.8), (1.2, 9.8),  # north-west office
)  # fmt: skip

# A corner is cut this far before and after it [m], or at half of the shorter leg.
_ROUNDING = 0.9


def office_plan() -> FloorPlan:
    """The office: a corridor, six rooms, a lobby; doors, desks, columns, slanted walls.

    The centre lines of the outer walls go around (0, 0) to (20, 14) [m].
    """
    half = _WALL / 2
    room = Rectangle(half, half, 20.0 - half, 14.0 - half)
    inner = (
        Rectangle(x0 - half, y0 - half, x1 + half, y1 + half) for x0, y0, x1, y1 in _INNER_WALLS
    )
    return FloorPlan((*walls_around(room, _WALL), *inner, _SLANTED_WALL, _CUT_CORNER, *_FURNITURE))


def office_drive(pose_count: int = 320) -> tuple[Pose2, ...]:
    """A drive through the corridor and every room, as poses of the sensor.

    Args:
        pose_count: poses, equally far apart along the way (about 0.3 m for 320).

    Returns:
        The poses; the heading is that of the motion, without jumps.

    Raises:
        ConfigError: fewer than 2 poses.
    """
    if pose_count < 2:
        raise ConfigError(f"office_drive: pose_count must be at least 2, got {pose_count}")
    way = _rounded(np.array(_WAY))
    steps = np.diff(way, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    travelled = np.concatenate([[0.0], np.cumsum(lengths)])
    wanted = np.linspace(0.0, travelled[-1], pose_count)
    x = np.interp(wanted, travelled, way[:, 0])
    y = np.interp(wanted, travelled, way[:, 1])
    # Heading at the middle of each piece of the way, unwrapped so that it can be interpolated.
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    theta = np.interp(wanted, (travelled[1:] + travelled[:-1]) / 2, headings)
    theta = (theta + math.pi) % (2 * math.pi) - math.pi
    return tuple(Pose2(*pose) for pose in zip(x.tolist(), y.tolist(), theta.tolist(), strict=True))


def _rounded(way: FloatArray) -> FloatArray:
    """Replace each corner by a parabola that leaves and meets its legs along them.

    It stays in the triangle of the corner: no farther from the legs than they allow.
    """
    pieces = [way[:1]]
    u = np.linspace(0.0, 1.0, 33)[:, None]
    for before, corner, after in zip(way[:-2], way[1:-1], way[2:], strict=True):
        legs = before - corner, after - corner
        lengths = [float(np.hypot(*leg)) for leg in legs]
        cut = min(_ROUNDING, *(length / 2 for length in lengths))
        start, end = (corner + leg * (cut / n) for leg, n in zip(legs, lengths, strict=True))
        pieces.append((1 - u) ** 2 * start + 2 * u * (1 - u) * corner + u**2 * end)
    rounded = np.concatenate([*pieces, way[-1:]])
    # Where two corners share a short leg, one ends on the point at which the next starts.
    moved = np.concatenate([[True], (np.diff(rounded, axis=0) != 0).any(axis=1)])
    return np.asarray(rounded[moved])
