# SPDX-License-Identifier: Apache-2.0
"""The causes of readings against every outcome of a few cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.forward.model import ForwardModel
from oddsmap.kernels.infer.beam_factor import NAT, BeamRows
from oddsmap.kernels.infer.responsibilities import DROPOUT, LIKELIHOOD, RANDOM, SQUARES, causes
from tests.naive import predictions as naive

MODEL = ForwardModel(
    cone_deg=20.0, range_max=2.0, range_min=0.1, p_random=0.1, p_dropout=0.07, sigma=0.06
)
WIDTH = 0.05

readings = st.one_of(st.just(math.inf), st.just(2.0), st.floats(0.1, 1.99))


@settings(max_examples=80)
@given(st.integers(0, 2**32 - 1), st.lists(readings, min_size=1, max_size=3))
def test_causes_are_those_of_every_outcome(seed: int, ranges: list[float]) -> None:
    rng = np.random.default_rng(seed)
    sizes = rng.integers(0, 6, len(ranges))
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    rows = BeamRows(
        np.array(ranges),
        offsets,
        rng.integers(0, 6, offsets[-1]).astype(np.int32),
        np.concatenate([np.empty(0), *(np.sort(rng.integers(0, 41, n)) for n in sizes)]).astype(
            np.uint16
        ),
        rng.uniform(0.1, 1.0, offsets[-1]).astype(np.float32),
    )
    belief = (rng.normal(0, 2, 6) * NAT).astype(np.int64)
    messages = (rng.normal(0, 1, offsets[-1]) * NAT).astype(np.int32)
    detection = rng.uniform(0.2, 1.0, 6) if rng.random() < 0.5 else np.array([0.9])
    out = np.full((len(ranges), 4), np.nan)
    causes(
        rows, MODEL.noise(0.2)._replace(bin_width=WIDTH), detection, belief, messages, out
    )  # fmt: skip
    for beam, z in enumerate(ranges):
        mine = range(offsets[beam], offsets[beam + 1])
        cells = []
        for i in mine:
            cavity = (belief[rows.cells[i]] - messages[i]) / NAT
            chance = detection[rows.cells[i] if len(detection) > 1 else 0] * rows.fractions[i]
            cells.append((int(rows.bins[i]), float(chance) / (1 + math.exp(-cavity))))
        expected = naive.causes(MODEL, z, cells, WIDTH)
        assert out[beam] == pytest.approx(expected, rel=1e-6, abs=1e-12)


def test_columns() -> None:
    """One certain wall at 1 m: a reading there is an echo, one elsewhere random, none a dropout."""
    rows = BeamRows(
        np.array([1.025, 0.4, np.inf]),
        np.array([0, 1, 2, 3]),
        np.zeros(3, np.int32),
        np.full(3, 20, np.uint16),
        np.ones(3, np.float32),
    )
    out = np.empty((3, 4))
    noise = MODEL.noise(0.2)._replace(bin_width=WIDTH)
    causes(rows, noise, np.ones(1), np.array([30 * NAT]), np.zeros(3, np.int32), out)
    assert out[0, RANDOM] < 0.03
    assert out[0, SQUARES] == pytest.approx(0.0, abs=1e-12)
    assert out[1, RANDOM] == pytest.approx(1.0, abs=1e-6)
    assert out[2, DROPOUT] == pytest.approx(1.0, abs=1e-6)
    assert out[2, LIKELIHOOD] == pytest.approx(MODEL.p_dropout, abs=1e-6)


def test_a_reading_that_nothing_explains_has_shares() -> None:
    """60 certain cells, no dropouts, and yet no return: too little for a number of 64 bits."""
    rows = BeamRows(
        np.array([np.inf]),
        np.array([0, 60]),
        np.arange(60, dtype=np.int32),
        np.arange(60).astype(np.uint16),
        np.ones(60, np.float32),
    )
    out = np.empty((1, 4))
    noise = MODEL.noise(0.2)._replace(bin_width=WIDTH, p_dropout=0.0)
    nothing = np.zeros(60, np.int32)
    causes(rows, noise, np.ones(1), np.full(60, 64 * NAT), nothing, out)
    assert np.isfinite(np.log(out[0, LIKELIHOOD]))
    assert out[0, RANDOM] == out[0, DROPOUT] == out[0, SQUARES] == 0.0
