# SPDX-License-Identifier: Apache-2.0
"""The forward sensor model in plain Python: one cell, one angle, one outcome at a time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

from oddsmap.forward.model import ForwardModel

Cell = tuple[int, ...]
Listed = dict[Cell, tuple[int, float, float]]
"""Cell -> bin, fraction, and how far the range is from the next border of a bin or the reach."""


def turned(angle: float) -> float:
    """The same angle between -pi and pi."""
    return math.remainder(angle, 2 * math.pi)


def nearest(origin: Sequence[float], cell: Cell) -> float:
    return math.dist(origin, [min(max(o, i), i + 1) for o, i in zip(origin, cell, strict=True)])


def around(origin: Sequence[float], reach: float) -> Iterator[Cell]:
    """Every cell within reach but the sensor's own."""
    own = tuple(math.floor(o) for o in origin)
    spans = [range(math.floor(o - reach) - 1, math.floor(o + reach) + 2) for o in origin]
    return (cell for cell in product(*spans) if cell != own)


def cell_angles(origin: Sequence[float], cell: Cell) -> tuple[float, float]:
    """Middle direction and half extent of a cell of the plane seen from outside of it.

    All four corners relative to the direction of the centre, which lies between them.
    """
    centre = math.atan2(cell[1] + 0.5 - origin[1], cell[0] + 0.5 - origin[0])
    off = [
        turned(math.atan2(y - origin[1], x - origin[0]) - centre)
        for x in (cell[0], cell[0] + 1)
        for y in (cell[1], cell[1] + 1)
        if (x, y) != tuple(origin)  # the sensor on a corner: the others say it all
    ]
    return centre + (max(off) + min(off)) / 2, (max(off) - min(off)) / 2


def plane_fraction(origin: Sequence[float], axis: float, half: float, cell: Cell) -> float:
    middle, extent = cell_angles(origin, cell)
    off = abs(turned(middle - axis))
    # The cone may meet the cell on both sides of the circle.
    both = max(0.0, min(off + extent, half) - max(off - extent, -half))
    both += max(0.0, min(off + extent, half + 2 * math.pi) - max(off - extent, 2 * math.pi - half))
    return both / (2 * min(extent, half))


def meets_ray(origin: Sequence[float], angle: float, cell: Cell) -> bool:
    """Whether a ray passes through a cell: slabs, one axis after the other."""
    near, far = 0.0, math.inf
    for o, d, i in zip(origin, (math.cos(angle), math.sin(angle)), cell, strict=True):
        if abs(d) < 1e-15:
            if not i <= o <= i + 1:
                return False
            continue
        a, b = sorted(((i - o) / d, (i + 1 - o) / d))
        near, far = max(near, a), min(far, b)
    return near < far


def disc_share(apart: float, small: float, large: float, steps: int = 1000) -> float:
    """Share of a small disc that lies in a larger one, by adding up strips."""
    area = 0.0
    for i in range(steps):
        x = small * (2 * (i + 0.5) / steps - 1)
        within_small = small * small - x * x
        within_large = large * large - (x + apart) * (x + apart)
        if within_large > 0:
            area += 2 * math.sqrt(min(within_small, within_large)) * 2 * small / steps
    return area / (math.pi * small * small)


def space_fraction(
    origin: Sequence[float], axis: Sequence[float], half: float, cell: Cell, radius: float
) -> float:
    way = [i + 0.5 - o for i, o in zip(cell, origin, strict=True)]
    distance = math.hypot(*way)
    along = sum(w * a for w, a in zip(way, axis, strict=True))
    beside = math.dist(way, [along * a for a in axis])
    theta, rho = math.atan2(beside, along), min(radius / distance, math.pi / 2)
    return disc_share(theta, min(rho, half), max(rho, half))


def bin_likelihood(model: ForwardModel, z: float, k: int | None, width: float) -> float:
    """p(z | first echo from bin k), None: no echo at all."""
    echo = 1 - model.p_random - model.p_dropout
    r = math.inf if k is None else (k + 0.5) * width
    if z >= model.range_max:
        if k is None:
            return 1 - model.p_random
        return model.p_dropout + echo * 0.5 * math.erfc(
            (model.range_max - r) / model.sigma / math.sqrt(2)
        )
    anywhere = model.p_random * width / (model.range_max - model.range_min)
    if k is None:
        return anywhere
    density = math.exp(-(((z - r) / model.sigma) ** 2) / 2) / model.sigma / math.sqrt(2 * math.pi)
    return echo * density * width + anywhere


def first_echo(cells: Sequence[tuple[int, float]]) -> dict[int | None, float]:
    """Which bin the first echo comes from, over every outcome of which cells return the beam.

    Args:
        cells: bin and chance of an echo of each cell.
    """
    chances: dict[int | None, float] = {}
    for heard in product((False, True), repeat=len(cells)):
        p = math.prod(d if h else 1 - d for (_, d), h in zip(cells, heard, strict=True))
        bins = [k for (k, _), h in zip(cells, heard, strict=True) if h]
        first = min(bins) if bins else None
        chances[first] = chances.get(first, 0.0) + p
    return chances


def likelihood(
    model: ForwardModel, z: float, cells: Sequence[tuple[int, float]], width: float
) -> float:
    """f(m) as in the formula: bin by bin, every product written out."""
    total = 0.0
    for k in sorted({k for k, _ in cells}):
        before = math.prod(1 - d for j, d in cells if j < k)
        here = math.prod(1 - d for j, d in cells if j == k)
        total += before * (1 - here) * bin_likelihood(model, z, k, width)
    return total + math.prod(1 - d for _, d in cells) * bin_likelihood(model, z, None, width)


def echo_by_bin(cells: Sequence[tuple[int, float]], bins: int) -> list[float]:
    """P(first echo from bin k) of k = 0, 1, ..., every product written out.

    Args:
        cells: bin and chance of an echo of each cell.
        bins: how many.
    """
    return [
        math.prod(1 - d for j, d in cells if j < k)
        * (1 - math.prod(1 - d for j, d in cells if j == k))
        for k in range(bins)
    ]
