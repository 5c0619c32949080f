# SPDX-License-Identifier: Apache-2.0
"""Nav2's inflation layer cell by cell, by its published formulas, with the nearest obstacle.

Source: nav2_costmap_2d: computeCost in inflation_layer.hpp, updateCosts in inflation_layer.cpp,
cellDistance in costmap_2d.cpp, the table in costmap_2d_publisher.cpp.
"""

from __future__ import annotations

import math

__all__ = ["inflated", "published"]

LETHAL, INSCRIBED, NO_INFORMATION, FREE = 254, 253, 255, 0


def compute_cost(cells: float, resolution: float, inscribed: float, scaling: float) -> int:
    """The cost at a distance in cells."""
    if cells == 0:
        return LETHAL
    if cells * resolution <= inscribed:
        return INSCRIBED
    factor = math.exp(-1.0 * scaling * (cells * resolution - inscribed))
    return int((INSCRIBED - 1) * factor)


def inflated(
    costs: list[list[int]],
    resolution: float,
    inscribed: float,
    radius: float,
    scaling: float,
    unknown: bool,
    around_unknown: bool,
) -> list[list[int]]:
    """All costs after the layer."""
    reach = max(0, math.ceil(radius / resolution))
    seeds = [
        (i, j)
        for j, row in enumerate(costs)
        for i, cost in enumerate(row)
        if cost == LETHAL or (around_unknown and cost == NO_INFORMATION)
    ]
    result = [list(row) for row in costs]
    for j, row in enumerate(costs):
        for i, old in enumerate(row):
            nearest = min((math.sqrt((i - x) ** 2 + (j - y) ** 2) for x, y in seeds), default=None)
            if nearest is None or nearest > reach:
                continue
            cost = compute_cost(nearest, resolution, inscribed, scaling)
            if old == NO_INFORMATION and (cost > FREE if unknown else cost >= INSCRIBED):
                result[j][i] = cost
            else:
                result[j][i] = max(old, cost)
    return result


def published(cost: int) -> int:
    """The value of an OccupancyGrid."""
    special = {FREE: 0, INSCRIBED: 99, LETHAL: 100, NO_INFORMATION: -1}
    return special[cost] if cost in special else int(1 + (97 * (cost - 1)) / 251)
