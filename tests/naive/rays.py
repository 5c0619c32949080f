# SPDX-License-Identifier: Apache-2.0
"""Rays through cells in rational arithmetic: every border, in order."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise

__all__ = ["Cell", "cells_along", "first_met"]

Cell = tuple[int, ...]


def cells_along(
    start: Sequence[float], way: Sequence[float], reach: float
) -> Iterator[tuple[Fraction, Cell]]:
    """The cells in which a ray has a length, in order, and where it enters each.

    Args:
        start: where it starts [cells].
        way: its direction, of any length.
        reach: how far it goes, in lengths of its direction.
    """
    p, v = [Fraction(x) for x in start], [Fraction(x) for x in way]
    end = Fraction(reach)
    at = {Fraction(0), end}
    for x, speed in zip(p, v, strict=True):
        if speed:
            low, high = sorted((x, x + end * speed))
            at |= {(k - x) / speed for k in range(math.ceil(low), math.floor(high) + 1)}
    borders = sorted(s for s in at if 0 <= s <= end)
    for s, after in pairwise(borders):
        middle = (s + after) / 2
        yield s, tuple(math.floor(x + middle * speed) for x, speed in zip(p, v, strict=True))


def first_met(
    states: Mapping[Cell, int],
    stop: set[int],
    start: Sequence[float],
    way: Sequence[float],
    reach: float,
) -> tuple[Fraction, Cell, int] | None:
    """The first cell in one of some states: where it is entered, and its state; -1: unknown."""
    for s, cell in cells_along(start, way, reach):
        state = states.get(cell, -1)
        if state in stop:
            return s, cell, state
    return None
