# SPDX-License-Identifier: Apache-2.0
"""Columns and what keeps a robot from their floor, one by one."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

__all__ = ["floor_of", "slope_at", "verdict_of"]

FREE, UNDECIDED, OCCUPIED = 1, 2, 3
Column = Mapping[int, int]
"""z index -> state, of the cells that are known."""


def floor_of(column: Column, ground: float, side: float, reach: float) -> float | None:
    """The top of the highest occupied cell near the ground."""
    tops = [(z + 1) * side for z, state in column.items() if state == OCCUPIED]
    return max((top for top in tops if abs(top - ground) <= reach + 1e-9), default=None)


def slope_at(
    floors: Mapping[tuple[int, int], float], x: int, y: int, half: int, side: float
) -> float:
    """Rise over way of the plane of least squares through the floors around."""
    near = [
        (i, j) for i in range(x - half, x + half + 1) for j in range(y - half, y + half + 1)
        if (i, j) in floors
    ]  # fmt: skip
    if (x, y) not in floors or len(near) < 6:
        return 0.0
    rows = np.array([(i - x, j - y, 1.0) for i, j in near])
    if np.linalg.matrix_rank(rows) < 3:
        return 0.0
    (a, b, _), *_ = np.linalg.lstsq(rows, np.array([floors[cell] for cell in near]), rcond=None)
    return math.hypot(a, b) / side


def verdict_of(
    columns: Mapping[tuple[int, int], Column],
    x: int,
    y: int,
    *,
    ground: float,
    side: float,
    height: float,
    step: float,
    slope: float,
    half: int,
) -> str:
    """What a robot meets in a column; all columns have the same height of ground here."""
    reach = max(0.3, step)

    def blocked(column: Column, what: int) -> bool:
        level = floor_of(column, ground, side, reach)
        level = ground if level is None else level
        return any(
            state == what
            and level < (z + 0.5) * side < level + height
            and (what == OCCUPIED or (z + 1) * side > level + step + 1e-9)
            for z, state in column.items()
        )

    floors = {}
    for cell, column in columns.items():
        level = floor_of(column, ground, side, reach)
        if level is not None and not blocked(column, OCCUPIED):
            floors[cell] = level
    own = columns.get((x, y), {})
    level = floor_of(own, ground, side, reach)
    tops = {z: (z + 1) * side for z in own}
    if blocked(own, OCCUPIED):
        return "BLOCKED"
    if level is None and any(own[z] == FREE and tops[z] < ground - reach - 1e-9 for z in own):
        return "DROP"
    if level is None and not any(
        own[z] == FREE and abs(tops[z] - ground) <= reach + 1e-9 for z in own
    ):
        return "UNKNOWN"
    around = [(x + i, y + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    if (x, y) in floors and any(
        floors[(x, y)] - floors[other] > step + 1e-9 for other in around if other in floors
    ):
        return "STEP"
    if slope_at(floors, x, y, half, side) > slope:
        return "SLOPE"
    return "UNDECIDED" if blocked(own, UNDECIDED) else "FREE"
