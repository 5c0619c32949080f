# SPDX-License-Identifier: Apache-2.0
"""Messages of beams against all maps of their cells."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.forward.model import ForwardModel
from oddsmap.kernels.infer.beam_factor import (
    NAT,
    apply_messages,
    new_messages,
    passing_messages,
    sweep_in_turn,
)
from tests.naive.beam_factor import (
    RESOLUTION,
    Beam,
    FloatArray,
    beams,
    detections,
    models,
    mu,
    rows_of,
)

CELLS = 7
MODEL = ForwardModel(cone_deg=20.0, range_max=1.5)
NOISE = MODEL.noise(RESOLUTION)
ALL = np.array([0.98])


@given(st.data(), models, detections(CELLS))
def test_messages_against_all_maps(
    data: st.DataObject, model: ForwardModel, detection: FloatArray
) -> None:
    two = data.draw(st.lists(beams(CELLS), min_size=1, max_size=2))
    rows = rows_of(two)
    # Certain cells, too.
    chance = st.one_of(st.sampled_from([0.0, 1.0]), st.floats(1e-6, 1.0 - 1e-6))
    n = len(rows.cells)
    q = np.array(data.draw(st.lists(chance, min_size=n, max_size=n)))
    out = np.empty(n, np.int32)
    passing_messages(rows, q, model.noise(RESOLUTION), detection, out)
    for b, beam in enumerate(two):
        cavity = tuple(q[rows.offsets[b] : rows.offsets[b + 1]].tolist())
        for i in range(len(cavity)):
            one, zero = (mu(model, beam, cavity, i, m, detection) for m in (1, 0))
            got = out[rows.offsets[b] + i] / NAT
            assert abs(got - math.log(one / zero)) <= 1e-6, (beam, i)


def test_one_detection_serves_all_cells() -> None:
    rows = rows_of([Beam(0.5, ((3, 4, 1.0), (1, 19, 0.5), (0, 19, 1.0)))])
    q = np.array([0.2, 0.5, 0.7])
    one, each = np.empty(3, np.int32), np.empty(3, np.int32)
    passing_messages(rows, q, NOISE, np.array([0.6]), one)
    passing_messages(rows, q, NOISE, np.full(4, 0.6), each)
    np.testing.assert_array_equal(one, each)
    assert one.all()


def test_what_a_reading_says() -> None:
    """Free before it, occupied at it, nothing behind it."""
    # At 0.5 m with bins of 0.025 m: bin 20.
    rows = rows_of([Beam(0.5, ((0, 4, 1.0), (1, 20, 1.0), (2, 32, 1.0)))])
    out = np.empty(3, np.int32)
    passing_messages(rows, np.full(3, 0.2), NOISE, ALL, out)
    before, at, behind = out / NAT
    assert before < -1.0
    assert at > 1.0
    assert abs(behind) < 1e-3


world = st.lists(beams(CELLS), min_size=2, max_size=6)


@given(world)
def test_a_belief_is_its_messages_exactly(some: list[Beam]) -> None:
    """Beams in turn and together: no bit of the prior is lost on the way."""
    rows = rows_of(some)
    prior = np.arange(CELLS, dtype=np.int64) * NAT // 3 - NAT
    belief, messages = prior.copy(), np.zeros(len(rows.cells), np.int32)
    order = np.arange(len(some))
    for _ in range(3):
        assert sweep_in_turn(rows, order, NOISE, ALL, belief, messages, 0.0) >= 0.0
        fresh = np.empty_like(messages)
        new_messages(rows, order[::-1].copy(), NOISE, ALL, belief, messages, fresh)
        apply_messages(rows, order[::-1].copy(), belief, messages, fresh, 0.5)
    total = prior.copy()
    np.add.at(total, rows.cells, messages)
    np.testing.assert_array_equal(belief, total)


@given(world)
def test_a_sweep_passes_messages_one_beam_after_the_other(some: list[Beam]) -> None:
    rows = rows_of(some)
    prior = np.full(CELLS, -NAT, np.int64)
    belief, messages = prior.copy(), np.zeros(len(rows.cells), np.int32)
    sweep_in_turn(rows, np.arange(len(some)), NOISE, ALL, belief, messages, 0.0)
    slow = prior.copy()
    for b, beam in enumerate(some):
        part = slice(rows.offsets[b], rows.offsets[b + 1])
        alone = rows_of([beam])
        out = np.empty(len(alone.cells), np.int32)
        q = 1.0 / (1.0 + np.exp(-slow[alone.cells] / NAT))
        passing_messages(alone, q, NOISE, ALL, out)
        np.testing.assert_allclose(messages[part], out, atol=2)
        slow[alone.cells] += messages[part]
    # A message once taken back is not counted twice: with one beam a second sweep changes nothing.
    lone = rows_of(some[:1])
    belief, messages = prior.copy(), np.zeros(len(lone.cells), np.int32)
    sweep_in_turn(lone, np.zeros(1, np.int64), NOISE, ALL, belief, messages, 0.0)
    once = belief.copy()
    assert sweep_in_turn(lone, np.zeros(1, np.int64), NOISE, ALL, belief, messages, 0.0) == 0.0
    np.testing.assert_array_equal(belief, once)


@given(world, st.floats(0.0, 0.9))
def test_messages_are_put_in_place_with_damping(some: list[Beam], keep: float) -> None:
    rows = rows_of(some)
    belief = np.zeros(CELLS, np.int64)
    old = (np.arange(len(rows.cells)) * 1_000_003 % NAT).astype(np.int32)
    np.add.at(belief, rows.cells, old)
    order, fresh, messages = np.arange(len(some))[::-1].copy(), np.empty_like(old), old.copy()
    new_messages(rows, order, NOISE, ALL, belief, messages, fresh)
    np.testing.assert_array_equal(messages, old)
    moved = apply_messages(rows, order, belief, messages, fresh, keep)
    at = 0
    for b in order:
        for i in range(rows.offsets[b], rows.offsets[b + 1]):
            assert abs(messages[i] - (keep * old[i] + (1 - keep) * fresh[at])) <= 0.5001
            at += 1
    assert moved == np.sum(np.abs(messages.astype(np.int64) - old))


def test_a_reading_that_nothing_explains_says_nothing() -> None:
    # Turning over one of 60 certain cells lets no beam through: 0 / 0, no number of 31 bits.
    near = tuple((cell, cell // 4, 1.0) for cell in range(60))
    rows = rows_of([Beam(math.inf, near)])
    noise = MODEL.noise(RESOLUTION)._replace(p_dropout=0.0)
    out = np.empty(60, np.int32)
    passing_messages(rows, np.ones(60), noise, np.ones(1), out)
    assert (out == 0).all()
