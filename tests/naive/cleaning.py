# SPDX-License-Identifier: Apache-2.0
"""Which cells are dynamic, cell by cell, by the ends of credible intervals."""

from __future__ import annotations

from itertools import product

from scipy.stats import beta

__all__ = ["is_dynamic"]

Cell = tuple[int, ...]
Counts = dict[Cell, tuple[float, float]]
"""Hits and passes [votes] of the cells with evidence."""


def interval(hits: float, passes: float, level: float) -> tuple[float, float]:
    low, high = beta(0.5 + hits, 0.5 + passes).interval(level)
    return float(low), float(high)


def is_dynamic(counts: Counts, cell: Cell, level: float) -> bool:
    hits, passes = counts.get(cell, (0.0, 0.0))
    if passes == 0.0 or interval(hits, passes, level)[1] >= 0.5:
        return False
    for step in product((-1, 0, 1), repeat=len(cell)):
        if not any(step) or (len(step) == 3 and step[2] < 0):
            continue
        beside = tuple(i + j for i, j in zip(cell, step, strict=True))
        hits, passes = counts.get(beside, (0.0, 0.0))
        if hits > 0.0 and interval(hits, passes, level)[0] > 0.5:
            return False
    return True
