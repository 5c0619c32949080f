# SPDX-License-Identifier: Apache-2.0
"""The maximum of a function of one number, from few evaluations, and how sharp it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["Peak", "climb"]

# Steps towards a maximum that is far off, each as long as the ones before together.
_MAX_STEPS = 12


@dataclass(frozen=True, slots=True)
class Peak:
    """Where a function is largest.

    Args:
        place: the argument.
        value: of the function there.
        curvature: its second derivative there, of the parabola through three points; NaN where the
            maximum is at a bound.
    """

    place: float
    value: float
    curvature: float

    @property
    def error(self) -> float:
        """Standard error, for a log likelihood: 1 / sqrt(observed information); else NaN."""
        return 1.0 / math.sqrt(-self.curvature) if self.curvature < 0.0 else math.nan


def climb(
    function: Callable[[float], float], start: float, step: float, low: float, high: float
) -> Peak:
    """Climb to the next maximum, then place it by parabolas.

    Args:
        function: to be made large; it need not be smooth beyond a fraction of the first step.
        start: where to begin.
        step: about how far off the maximum may be.
        low: lowest argument.
        high: highest argument.
    """
    known: dict[float, float] = {}

    def value(x: float) -> float:
        if x not in known:
            known[x] = function(x)
        return known[x]

    middle = min(max(start, low), high)
    left, right = max(middle - step, low), min(middle + step, high)
    value(middle)  # before the others: of equal values the first known is the best, one inside
    for _ in range(_MAX_STEPS):
        if value(right) > value(middle) and right < high:
            left, middle, right = middle, right, min(right + 2.0 * (right - middle), high)
        elif value(left) > value(middle) and left > low:
            left, middle, right = max(left - 2.0 * (middle - left), low), left, middle
        else:
            break
    for _ in range(2):
        around = _around(known, step / 4.0)
        if around is None:
            break
        value(min(max(_parabola(around, known)[0], low), high))
    best = max(known, key=known.__getitem__)
    around = _around(known, step / 4.0)
    curvature = math.nan if around is None else _parabola(around, known)[1]
    return Peak(best, known[best], curvature)


def _around(known: dict[float, float], apart: float) -> tuple[float, float, float] | None:
    """The best argument and the next ones not nearer than `apart`, where noise has less say."""
    best = max(known, key=known.__getitem__)
    below = [x for x in known if x <= best - apart]
    above = [x for x in known if x >= best + apart]
    return (max(below), best, min(above)) if below and above else None


def _parabola(around: tuple[float, float, float], known: dict[float, float]) -> tuple[float, float]:
    """Top and second derivative of the parabola through three points, the middle one highest."""
    a, b, c = around
    before = (known[b] - known[a]) / (b - a)
    after = (known[c] - known[b]) / (c - b)
    curvature = 2.0 * (after - before) / (c - a)
    if curvature >= 0.0:
        return b, math.nan
    # The slope is `before` half way from a to b.
    return (a + b) / 2.0 - before / curvature, curvature
