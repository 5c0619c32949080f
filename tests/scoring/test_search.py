# SPDX-License-Identifier: Apache-2.0
"""The search for a maximum: where it is, how sharp, and at bounds."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from oddsmap.scoring.search import climb


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.1, 100))
@example(0.5, 0.0, 1.0)  # the start and the first step are as high
@example(-0.5, 0.0, 1.0)
def test_a_parabola_is_found_at_once(top: float, start: float, sharp: float) -> None:
    calls: list[float] = []

    def value(x: float) -> float:
        calls.append(x)
        return -0.5 * sharp * (x - top) ** 2

    peak = climb(value, start, 1.0, -10.0, 10.0)
    assert peak.place == pytest.approx(top, abs=1e-3)
    assert peak.curvature == pytest.approx(-sharp, rel=1e-3)
    assert peak.error == pytest.approx(1 / math.sqrt(sharp), rel=1e-3)
    assert len(calls) == len(set(calls)) <= 9


@pytest.mark.parametrize("start", [-0.4, 0.2, 0.9, 1.0, 1.7])
@pytest.mark.parametrize("slope", [3.0, -3.0])
def test_a_maximum_at_a_bound(start: float, slope: float) -> None:
    """Nothing is asked beyond the bounds, wherever the search starts."""
    calls: list[float] = []

    def value(x: float) -> float:
        calls.append(x)
        return slope * x

    peak = climb(value, start, 0.2, 0.0, 1.0)
    assert peak.place == (1.0 if slope > 0 else 0.0)
    assert math.isnan(peak.error)
    assert 0.0 <= min(calls) <= max(calls) <= 1.0


def test_noise_near_the_top_has_little_say() -> None:
    """Values are good to 0.01 only; the parabola is taken over a quarter of a step at least."""
    peak = climb(lambda x: round(-50 * (x - 0.3) ** 2, 2), 0.0, 0.5, -5.0, 5.0)
    assert peak.place == pytest.approx(0.3, abs=0.03)
    assert peak.curvature == pytest.approx(-100, rel=0.1)
