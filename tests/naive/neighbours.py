# SPDX-License-Identifier: Apache-2.0
"""What lies around a cell, in sums over single cells."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from fractions import Fraction

Cell = tuple[int, ...]

HIT_EDGES = [0.003, 0.01, 0.03, 0.1, 0.25, 0.5, 1.0, 2.0]
SEEN_EDGES = {2: [0.25, 0.5, 0.75], 3: [0.12, 0.25, 0.5, 0.75]}


def class_of(counts: Mapping[Cell, tuple[Fraction, Fraction]], cell: Cell) -> int:
    """The class of a cell by the hits and passes of those around it; 0: nothing was seen."""
    hit, seen, most = Fraction(0), Fraction(0), Fraction(0)
    for step in itertools.product(range(-4, 5), repeat=len(cell)):
        if not any(step):
            continue
        weight = Fraction(1, 2 ** sum(map(abs, step)))
        most += weight
        h, p = counts.get(tuple(a + b for a, b in zip(cell, step, strict=True)), (0, 0))
        hit += weight * Fraction(int(256 * h / (h + p + 1)), 256)
        seen += weight * Fraction(int(256 * (h + p) / (h + p + 1)), 256)
    if seen == 0:
        return 0
    edges = SEEN_EDGES[len(cell)]
    row = sum(hit >= Fraction(str(edge)) for edge in HIT_EDGES)
    return 1 + row * (len(edges) + 1) + sum(seen >= Fraction(str(edge)) * most for edge in edges)
