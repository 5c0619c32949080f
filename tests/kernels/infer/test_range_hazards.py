# SPDX-License-Identifier: Apache-2.0
"""Hazards along beams against the predictive distribution, written out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from oddsmap.forward.model import ForwardModel
from oddsmap.kernels.infer.range_hazards import tally_hazards
from tests.naive import predictions as naive

BINS = 15


@settings(max_examples=80)
@given(
    st.integers(0, 2**32 - 1),
    # Whole tenths lie on borders of steps, where rounding shows.
    st.one_of(st.just(math.inf), st.floats(0.0, 1.2), st.integers(0, 12).map(lambda n: n / 10)),
    st.sampled_from([0.0, 0.15]),
    st.sampled_from([0.1, 0.13, 2.0]),
)
@example(seed=0, beyond=1.0, range_min=0.15, step=0.1)
def test_hazards_are_those_of_the_distribution(
    seed: int, beyond: float, range_min: float, step: float
) -> None:
    rng = np.random.default_rng(seed)
    model = ForwardModel(
        cone_deg=20.0, range_max=1.2, range_min=range_min, p_random=0.1, p_dropout=0.05, sigma=0.04
    )
    width = 0.05
    z = range_min + beyond
    echo = rng.dirichlet(np.full(26, 0.2)) * rng.random()
    count, happened = np.zeros(BINS, np.int64), np.zeros(BINS, np.int64)
    predicted = np.zeros(BINS)
    noise = model.noise(0.1)._replace(bin_width=width)
    tally_hazards(np.array([z]), noise, echo[None], step, count, predicted, happened)
    expected = naive.hazards(model, z, echo.tolist(), width, step)
    assert count.sum() == len(expected)
    assert happened.sum() == sum(ends for _, ends in expected) == (z < model.range_max)
    assert predicted.sum() == pytest.approx(sum(h for h, _ in expected), abs=1e-6)
    near = [h * BINS - round(h * BINS) for h, _ in expected]
    if min(map(abs, near)) > 1e-6:  # no hazard on a border of bins
        bins = [min(int(h * BINS), BINS - 1) for h, _ in expected]
        assert count.tolist() == np.bincount(bins, minlength=BINS).tolist()
        ended = [b for b, (_, ends) in zip(bins, expected, strict=True) if ends]
        assert happened.tolist() == np.bincount(ended, minlength=BINS).tolist()
