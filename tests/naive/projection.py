# SPDX-License-Identifier: Apache-2.0
"""A band of heights of all cells at once: plain, and in the memory of all cells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.odds import Thresholds
from oddsmap.projection.ground_surface import fit_ground_surface

Surface = Callable[[FloatArray, FloatArray], FloatArray]


def project(
    index: IntArray,
    probability: FloatArray,
    resolution: float,
    band: tuple[float, float],
    ground: Surface | str | None,
    prior: float,
) -> ProbabilityMap:
    """As `oddsmap.project`, of listed cells, with the default thresholds."""
    lo, hi = index[:, :2].min(axis=0), index[:, :2].max(axis=0) + 1
    nx, ny = (int(n) for n in hi - lo)
    z = (index[:, 2] + 0.5) * resolution
    if ground is not None:
        if ground == "relative":
            limit = Thresholds()
            occupied, free = probability >= limit.occupied, probability <= limit.free
            ground = fit_ground_surface(index[occupied], resolution, index[free]).at
        assert callable(ground)
        number, cell = np.unique((index[:, :2] - lo) @ [1, nx], return_inverse=True)
        x, y = (number % nx + lo[0] + 0.5) * resolution, (number // nx + lo[1] + 0.5) * resolution
        z -= ground(x, y)[cell]
    inside = (z >= band[0]) & (z < band[1])
    largest = np.full(nx * ny, -1.0)
    np.maximum.at(largest, (index[inside, :2] - lo) @ [1, nx], probability[inside])
    observed = largest >= 0.0
    return ProbabilityMap(
        np.where(observed, largest, prior).reshape(ny, nx),
        observed.reshape(ny, nx),
        resolution,
        (float(lo[0]) * resolution, float(lo[1]) * resolution),
    )
