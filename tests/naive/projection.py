# SPDX-License-Identifier: Apache-2.0
"""A band of heights of all cells at once: plain, column by column, in the memory of all cells."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.odds import Thresholds, logit, sigmoid
from oddsmap.projection.ground_surface import fit_ground_surface

Surface = Callable[[FloatArray, FloatArray], FloatArray]


def project(
    index: IntArray,
    log_odds: FloatArray,
    resolution: float,
    band: tuple[float, float],
    ground: Surface | str | None,
    prior: float,
    slab: float | None,
) -> ProbabilityMap:
    """As `oddsmap.project`, of listed cells, with the default thresholds.

    Args:
        slab: height of a slab [m]; None: rule "largest".
    """
    lo, hi = index.min(axis=0), index.max(axis=0) + 1
    nx, ny = (int(n) for n in (hi - lo)[:2])
    number = (index[:, :2] - lo[:2]) @ [1, nx]
    known = np.unique(number)
    height = np.zeros(nx * ny)
    if ground is not None:
        if ground == "relative":
            limit, p = Thresholds(), sigmoid(log_odds)
            occupied, free = p >= limit.occupied, p <= limit.free
            ground = fit_ground_surface(index[occupied], resolution, index[free]).at
        assert callable(ground)
        x, y = (known % nx + lo[0] + 0.5) * resolution, (known // nx + lo[1] + 0.5) * resolution
        height[known] = ground(x, y)
    cells: dict[int, dict[int, float]] = defaultdict(dict)
    for column, z, value in zip(
        number.tolist(), index[:, 2].tolist(), log_odds.tolist(), strict=True
    ):
        cells[column][z] = value
    probability, observed = np.full(nx * ny, prior), np.zeros(nx * ny, np.bool_)
    # An end far beyond the map is none.
    z_min, z_max = (end if abs(end) < 1e6 else math.copysign(math.inf, end) for end in band)
    for column, values in cells.items():
        ground_height = float(height[column])
        seen = {
            z: value
            for z, value in values.items()
            if z_min <= (z + 0.5) * resolution - ground_height < z_max
        }
        if not seen:
            continue
        # However high the map is, a band has the same cells.
        low = int(lo[2]) if z_min < -1e6 else math.floor((z_min + ground_height) / resolution) - 2
        high = int(hi[2]) if z_max > 1e6 else math.floor((z_max + ground_height) / resolution) + 3
        layers = np.arange(low, high)
        above = (layers + 0.5) * resolution - ground_height
        inside = layers[(above >= z_min) & (above < z_max)]
        start = float(logit(prior))
        found = max(seen.values())
        if slab is not None and found - start <= -1e-9:
            found = _by_slabs(inside, seen, resolution, (z_min, z_max), start, slab)
        probability[column], observed[column] = sigmoid(found), True
    return ProbabilityMap(
        probability.reshape(ny, nx),
        observed.reshape(ny, nx),
        resolution,
        (float(lo[0]) * resolution, float(lo[1]) * resolution),
    )


def _by_slabs(
    inside: IntArray,
    seen: dict[int, float],
    resolution: float,
    band: tuple[float, float],
    start: float,
    slab: float,
) -> float:
    wanted = math.inf if slab == 0 else len(inside) * resolution / slab
    count = len(inside) if wanted >= len(inside) else max(1, round(wanted))
    slabs: list[list[float]] = [[] for _ in range(count)]
    for z, value in sorted(seen.items()):
        slabs[((z - int(inside[0]) + 1) * count - 1) // len(inside)].append(value - start)
    # Open ends ask for nothing beyond what was seen.
    while math.isinf(band[0]) and not slabs[0]:
        slabs.pop(0)
    while math.isinf(band[1]) and not slabs[-1]:
        slabs.pop()
    worst = -math.inf
    for evidence in slabs:
        worst = max(worst, sum(evidence))
    return start + worst
