# SPDX-License-Identifier: Apache-2.0
"""The solid things a floor plan is made of: rectangles, discs and polygons, in metres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError

__all__ = ["Disc", "Polygon", "Rectangle", "Shape", "walls_around"]


# A polygon thinner than this [m] on average is a line: nothing can be inside it.
_THINNEST = 1e-6


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle along the axes, from (`x_min`, `y_min`) to (`x_max`, `y_max`) [m].

    Raises:
        InputError: a corner is not finite, or a maximum is not above its minimum.
    """

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    def __post_init__(self) -> None:
        corners = (self.x_min, self.y_min, self.x_max, self.y_max)
        if not all(map(math.isfinite, corners)):
            raise InputError(f"Rectangle: corners must be finite [m], got {corners}")
        if not (self.x_min < self.x_max and self.y_min < self.y_max):
            raise InputError(
                f"Rectangle: x_min < x_max and y_min < y_max must hold, got {corners}: "
                "give x_min, y_min, x_max, y_max"
            )

    @property
    def vertices(self) -> FloatArray:
        """Corners [m], anticlockwise, shape (4, 2)."""
        a, b, c, d = self.x_min, self.y_min, self.x_max, self.y_max
        return np.array([(a, b), (c, b), (c, d), (a, d)], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Disc:
    """A disc, such as a round column, with its centre (`x`, `y`) and `radius` [m].

    Raises:
        InputError: a number is not finite, or the radius is not positive.
    """

    x: float
    y: float
    radius: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.x) and math.isfinite(self.y)):
            raise InputError(f"Disc: the centre must be finite [m], got ({self.x}, {self.y})")
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise InputError(f"Disc: the radius must be positive and finite [m], got {self.radius}")


@dataclass(frozen=True, slots=True)
class Polygon:
    """A polygon, in either sense of rotation; the last corner is joined to the first.

    Where edges cross each other, what is inside follows the even-odd rule.

    Args:
        points: corners [m], at least 3 pairs (x, y).

    Raises:
        InputError: fewer than 3 corners, a number that is not finite, a corner that repeats the
            one before it, or no area.
    """

    points: tuple[tuple[float, float], ...]

    def __init__(self, points: Sequence[Sequence[float]] | npt.NDArray[np.floating]) -> None:
        try:
            pairs = tuple((float(x), float(y)) for x, y in points)
        except (TypeError, ValueError):
            raise InputError(
                f"Polygon: corners must be pairs of numbers (x, y) [m], got {points!r:.80}"
            ) from None
        object.__setattr__(self, "points", pairs)
        _check_polygon(self.vertices)

    @property
    def vertices(self) -> FloatArray:
        """Corners [m] in the order given, shape (n, 2)."""
        return np.array(self.points, dtype=np.float64).reshape(-1, 2)


Shape = Rectangle | Disc | Polygon


def walls_around(room: Rectangle, thickness: float) -> tuple[Rectangle, ...]:
    """Four solid walls around a room, outside of it, without gap or overlap.

    Args:
        room: the space within, up to the inner faces of the walls.
        thickness: of each wall [m].

    Returns:
        The walls in the south, north, west and east.

    Raises:
        InputError: the thickness is not positive and finite.
    """
    if not (math.isfinite(thickness) and thickness > 0):
        raise InputError(f"walls_around: thickness must be positive and finite, got {thickness}")
    west, east = room.x_min - thickness, room.x_max + thickness
    return (
        Rectangle(west, room.y_min - thickness, east, room.y_min),
        Rectangle(west, room.y_max, east, room.y_max + thickness),
        Rectangle(west, room.y_min, room.x_min, room.y_max),
        Rectangle(room.x_max, room.y_min, east, room.y_max),
    )


def _check_polygon(vertices: FloatArray) -> None:
    if len(vertices) < 3:
        raise InputError(f"Polygon: at least 3 corners are needed, got {len(vertices)}")
    if not np.isfinite(vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
        raise InputError(f"Polygon: corner {bad} is not finite: {tuple(vertices[bad].tolist())}")
    # From the first corner, so that a plan in UTM coordinates loses no digits.
    x, y = (vertices - vertices[0]).T
    edges = np.roll(vertices, -1, axis=0) - vertices
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    if (lengths == 0).any():
        bad = int(np.flatnonzero(lengths == 0)[0])
        raise InputError(
            f"Polygon: the corner after corner {bad} repeats it, {tuple(vertices[bad].tolist())}: "
            "leave one out (the last is joined to the first by itself)"
        )
    area = abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))) / 2
    if area < _THINNEST * float(lengths.max()):
        raise InputError(
            f"Polygon: the corners enclose no area ({area:.3g} m2): a line is not a solid"
        )
