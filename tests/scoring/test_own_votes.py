# SPDX-License-Identifier: Apache-2.0
"""Votes predicted from the others of their cell: against a loop over single votes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import BeamSensor, EvidenceMap
from oddsmap.posterior.count_pairs import count_pairs
from oddsmap.scoring.own_votes import OwnVotes, predict_own_votes
from tests.kit import ONE, add_votes

COUNTS = st.lists(st.tuples(st.integers(0, 9), st.integers(0, 300)).filter(any), max_size=12)


def told(counts: list[tuple[int, int]], sensor: BeamSensor | None = None) -> OwnVotes | None:
    grid = EvidenceMap(0.1, sensor=sensor)
    add_votes(grid, {(i, i % 3): (h * ONE, p * ONE) for i, (h, p) in enumerate(counts)})
    return predict_own_votes(grid.log_odds(), count_pairs(grid))


@given(COUNTS)
@settings(max_examples=50, deadline=None)
def test_it_is_a_sum_over_single_votes(counts: list[tuple[int, int]]) -> None:
    found = told(counts, BeamSensor(p_hit=0.8, p_miss=0.45))
    several = [(h, p) for h, p in counts if h + p > 1]
    if not several:
        assert found is None
        return
    share = sum(h for h, _ in several) / sum(h + p for h, p in several)
    share = min(max(share, 1e-9), 1 - 1e-9)

    def loss(h: int, p: int, hit: bool) -> float:
        x = h * math.log(0.8 / 0.2) + p * math.log(0.45 / 0.55)
        q = min(max(1.0 / (1.0 + math.exp(-x)), 1e-9), 1 - 1e-9)
        return -math.log(q if hit else 1 - q)

    log_odds, constant, squares, sure, votes = 0.0, 0.0, 0.0, 0.0, 0
    for h, p in several:
        ours = theirs = 0.0
        for hit, rest in [(True, (h - 1, p))] * h + [(False, (h, p - 1))] * p:
            said, number = loss(*rest, hit), -math.log(share if hit else 1 - share)
            ours, theirs = ours + said, theirs + number
            if not 0.01 < math.exp(-loss(*rest, True)) < 0.99:
                sure += said - number
        log_odds, constant, votes = log_odds + ours, constant + theirs, votes + h + p
        squares += (ours - theirs) ** 2
    assert found is not None
    assert (found.votes, found.cells) == (votes, len(several))
    assert found.log_odds == pytest.approx(log_odds / votes, rel=1e-6)
    assert found.constant == pytest.approx(constant / votes, rel=1e-6)
    assert found.error == pytest.approx(math.sqrt(squares) / votes, rel=1e-6, abs=1e-12)
    assert found.excess_where_sure == pytest.approx(sure / votes, rel=1e-6, abs=1e-9)
    assert not found.log_odds_fail  # of so few cells


def test_cells_that_are_hit_now_and_then_are_where_log_odds_fail() -> None:
    rng = np.random.default_rng(0)
    hits = rng.binomial(200, 0.3, 600)
    beside_walls = [(int(h), 200 - int(h)) for h in hits]
    free = [(0, 90)] * 600
    found, fine = told(beside_walls + free), told(free + [(5, 0)] * 500)
    assert found is not None
    assert found.log_odds_fail
    assert found.too_sure
    assert fine is not None
    assert not fine.log_odds_fail
    # The same of a few hundred cells is not said.
    few = told(beside_walls[:100] + free[:100])
    assert few is not None
    assert few.log_odds > few.constant
    assert not few.log_odds_fail


def test_two_votes_a_cell_leave_log_odds_near_the_prior() -> None:
    found = told([(0, 2)] * 1900 + [(2, 0)] * 30)
    assert found is not None
    assert found.log_odds_fail
    assert not found.too_sure


def test_shared_and_faded_votes_are_not_judged() -> None:
    grid = EvidenceMap(0.1)
    add_votes(grid, {(0, 0): (5 * ONE // 2, 7 * ONE), (1, 0): (ONE, 9 * ONE)})
    assert predict_own_votes(grid.log_odds(), count_pairs(grid)) is None
