# SPDX-License-Identifier: Apache-2.0
"""Messages between neighbours against all maps of a chain, and against the neighbours by index."""

from __future__ import annotations

import math
from itertools import pairwise, product

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.kernels.infer.beam_factor import NAT
from oddsmap.kernels.infer.ising import pass_from_blocks, pass_to_neighbours

SIDE, BLOCKS = 3, 2
LENGTH = SIDE * BLOCKS


def enumerated(log_odds: list[float], strength: float) -> list[float]:
    """Marginal log odds of each cell of a chain, over all its maps."""
    total = np.zeros((2, len(log_odds)))
    for m in product((0, 1), repeat=len(log_odds)):
        equal = sum(one == other for one, other in pairwise(m))
        weight = math.exp(strength * equal + sum(o * x for o, x in zip(log_odds, m, strict=True)))
        for i, x in enumerate(m):
            total[x, i] += weight
    return [float(x) for x in np.log(total[1] / total[0])]


@given(
    st.lists(st.floats(-8.0, 8.0), min_size=LENGTH, max_size=LENGTH),
    st.sampled_from([0.0, 0.1, 0.8, 3.0, -0.5]),
)
def test_a_chain_against_all_maps(log_odds: list[float], strength: float) -> None:
    """Messages are exact where neighbours form no loop; the chain lies in two blocks."""
    beside = np.array([[-1, 1], [0, -1]], np.int32)
    belief = np.rint(np.array(log_odds) * NAT).astype(np.int64)
    messages = np.zeros((LENGTH, 2), np.int32)
    # One sweep carries messages all the way up, and down by a cell at least.
    for _ in range(LENGTH):
        pass_to_neighbours(beside, SIDE, 1, strength, belief, messages)
    assert pass_to_neighbours(beside, SIDE, 1, strength, belief, messages) == 0.0
    np.testing.assert_allclose(belief / NAT, enumerated(log_odds, strength), atol=1e-6)


def joined(d: int) -> npt.NDArray[np.int32]:
    """Two blocks side by side along the last axis."""
    beside = np.full((2, 2 * d), -1, np.int32)
    beside[0, 2 * d - 1] = 1
    beside[1, 2 * d - 2] = 0
    return beside


@pytest.mark.parametrize("d", [2, 3])
def test_messages_come_from_the_cells_beside(d: int) -> None:
    """At rest each message follows from its sender's belief without what the receiver told it."""
    cells = SIDE**d
    belief = np.random.default_rng(d).integers(-2 * NAT, 2 * NAT, 2 * cells)
    prior = belief.copy()
    messages = np.zeros((2 * cells, 2 * d), np.int32)
    strength = 0.4
    for _ in range(60):
        moved = pass_to_neighbours(joined(d), SIDE, d, strength, belief, messages)
    assert moved < 1e-4 * NAT
    np.testing.assert_array_equal(belief, prior + messages.sum(axis=1, dtype=np.int64))
    extent = [SIDE] * (d - 1) + [2 * SIDE]
    number = {}
    for place in product(*(range(n) for n in extent)):  # x first
        block, within = divmod(place[-1], SIDE)
        at = sum(x * SIDE**axis for axis, x in enumerate((*place[:-1], within)))
        number[place] = block * cells + at
    e = math.exp(strength)
    for place, i in number.items():
        for axis, up in product(range(d), (0, 1)):
            other = (*place[:axis], place[axis] + 2 * up - 1, *place[axis + 1 :])
            got = messages[i, 2 * axis + up] / NAT
            if other not in number:
                assert got == 0.0
                continue
            j = number[other]
            x = math.exp((belief[j] - messages[j, 2 * axis + 1 - up]) / NAT)
            assert got == pytest.approx(math.log((e * x + 1) / (x + e)), abs=1e-4)


def test_no_coupling_says_nothing() -> None:
    belief = np.arange(SIDE**2, dtype=np.int64) * NAT
    messages = np.zeros((SIDE**2, 4), np.int32)
    beside = np.full((1, 4), -1, np.int32)
    assert pass_to_neighbours(beside, SIDE, 2, 0.0, belief, messages) == 0.0
    np.testing.assert_array_equal(belief, np.arange(SIDE**2) * NAT)


def test_certain_neighbours_say_at_most_the_strength() -> None:
    """No overflow at beliefs of thousands of nats."""
    belief = np.array([5000 * NAT, 0, -5000 * NAT], np.int64)
    messages = np.zeros((3, 2), np.int32)
    pass_to_neighbours(np.full((1, 2), -1, np.int32), 3, 1, 0.8, belief, messages)
    np.testing.assert_allclose(messages[1] / NAT, [0.8, -0.8], atol=1e-6)


def test_some_blocks_tell_theirs_alone() -> None:
    """All blocks in turn are the whole pass; one of them moves only what its cells tell."""
    cells = SIDE**2
    start = np.random.default_rng(0).integers(-2 * NAT, 2 * NAT, 2 * cells)
    whole, parts, first = start.copy(), start.copy(), start.copy()
    told = np.zeros((3, 2 * cells, 4), np.int32)
    moved = pass_to_neighbours(joined(2), SIDE, 2, 0.4, whole, told[0])
    for blocks in ([0], [1]):
        moved -= pass_from_blocks(np.array(blocks), joined(2), SIDE, 2, 0.4, parts, told[1])
    assert moved == 0
    np.testing.assert_array_equal(parts, whole)
    np.testing.assert_array_equal(told[1], told[0])
    pass_from_blocks(np.array([0]), joined(2), SIDE, 2, 0.4, first, told[2])
    # Block 1 lies above block 0 along y: its first row alone is told something, from below.
    assert (told[2, cells : cells + SIDE, 2] != 0).all()
    told[2, cells : cells + SIDE, 2] = 0
    assert not told[2, cells:].any()
