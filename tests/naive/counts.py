# SPDX-License-Identifier: Apache-2.0
"""Distributions of reflectivity and p(occupied), in sums over single cells."""

from __future__ import annotations

import math
from collections.abc import Sequence

GRID = [1.0 / (1.0 + math.exp(9.2 - 14.5 * j / 47)) for j in range(48)]
"""Reflectivities that a cell may have."""


def occupied_at(r: float) -> float:
    """p(occupied) of a cell that reflects a share r of its beams."""
    odds: float = (r / (1.0 - r) * (1.0 - 0.27) / 0.27) ** 4
    return 3e-4 + (1.0 - 6e-4) * odds / (1.0 + odds)


def bell(r: float, mean: float, deviation: float) -> float:
    """A normal density of logit(r), but for its factor."""
    away = math.log(r / (1.0 - r)) - math.log(mean / (1.0 - mean))
    return math.exp(-0.5 * (away / deviation) ** 2)


def start() -> list[float]:
    """What is expected of any map."""
    free, occupied = [bell(r, 0.003, 2.0) for r in GRID], [bell(r, 0.55, 1.2) for r in GRID]
    return [
        0.9 * f / sum(free) + 0.1 * o / sum(occupied) for f, o in zip(free, occupied, strict=True)
    ]


def mixed(tables: Sequence[Sequence[float]], beams: float) -> list[float]:
    """The distribution among cells that so many beams entered."""
    place = min(math.log2(1.0 + beams), 7.0)
    k = min(int(place), 6)
    u = place - k
    return [(1.0 - u) * a + u * b for a, b in zip(tables[k], tables[k + 1], strict=True)]


def fitted(
    cells: Sequence[tuple[float, float]], steps: int, expected: list[float] | None = None
) -> list[list[float]]:
    """The distributions after some steps of expectation maximisation."""
    first = whole = expected or start()
    for _ in range(steps):
        total = [10.0 * f for f in first]
        for h, p in cells:
            joint = [f * r**h * (1.0 - r) ** p for f, r in zip(whole, GRID, strict=True)]
            total = [t + j / sum(joint) for t, j in zip(total, joint, strict=True)]
        whole = [t / sum(total) for t in total]
    tables = [whole for _ in range(8)]
    for _ in range(steps):
        totals = [[50.0 * f for f in whole] for _ in range(8)]
        for h, p in cells:
            place = min(math.log2(1.0 + h + p), 7.0)
            k = min(int(place), 6)
            shares = {k: 1.0 - (place - k), k + 1: place - k}
            likelihood = [r**h * (1.0 - r) ** p for r in GRID]
            evidence = sum(
                share * f * like
                for n, share in shares.items()
                for f, like in zip(tables[n], likelihood, strict=True)
            )
            for n, share in shares.items():
                for j, like in enumerate(likelihood):
                    totals[n][j] += share * tables[n][j] * like / evidence
        tables = [[t / sum(row) for t in row] for row in totals]
    return [whole, *tables[1:]]


def p_occupied(tables: Sequence[Sequence[float]], h: float, p: float) -> float:
    """p(occupied) of a cell, the prior being the fitted one."""
    prior = mixed(tables, h + p)
    joint = [f * r**h * (1.0 - r) ** p for f, r in zip(prior, GRID, strict=True)]
    occupied = [j * occupied_at(r) for j, r in zip(joint, GRID, strict=True)]
    return float(sum(occupied) / sum(joint))
