# SPDX-License-Identifier: Apache-2.0
"""Hits and passes of other scans, predicted by a map's cells."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import EvidenceMap, InputError
from oddsmap.posterior.count_fit import fit_beta
from oddsmap.posterior.count_pairs import count_pairs
from oddsmap.scoring.reflection import ReflectionScores, score_reflection
from tests.kit import ONE, add_votes

Votes = dict[tuple[int, int], tuple[int, int]]
CELLS = st.dictionaries(
    st.tuples(st.integers(0, 4), st.integers(0, 4)),
    st.tuples(st.integers(0, 9), st.integers(0, 9)).filter(any),
    min_size=1,
)


def map_of(votes: Votes) -> EvidenceMap:
    grid = EvidenceMap(0.1)
    add_votes(grid, {cell: (h * ONE, p * ONE) for cell, (h, p) in votes.items()})
    return grid


def scored(ours: Votes, theirs: Votes) -> ReflectionScores:
    return score_reflection(map_of(ours), map_of(theirs))


@given(CELLS, CELLS)
@settings(max_examples=50, deadline=None)
def test_scores_are_sums_over_single_votes(ours: Votes, theirs: Votes) -> None:
    if not ours.keys() & theirs.keys():
        with pytest.raises(InputError, match="no beam of these scans enters a cell"):
            scored(ours, theirs)
        return
    found = scored(ours, theirs)
    a, b = fit_beta(count_pairs(map_of(ours)))
    events = []  # of single votes: cell, hit
    for cell in ours.keys() & theirs.keys():
        hits, passes = theirs[cell]
        events += [(cell, True)] * hits + [(cell, False)] * passes
    assert found.votes == len(events)
    assert found.votes + found.unknown == sum(map(sum, theirs.values()))

    def textbook(h: int, p: int) -> float:
        odds = (0.7 / 0.3) ** h * (0.4 / 0.6) ** p
        return odds / (1.0 + odds)

    hit_share = sum(hit for _, hit in events) / len(events)
    ways: dict[str, Callable[[int, int], float]] = {
        "log odds": textbook,
        "OctoMap's clamps": lambda h, p: min(max(textbook(h, p), 0.1192), 0.971),
        "Beta(1, 1)": lambda h, p: (1 + h) / (2 + h + p),
        "calibrated": lambda h, p: (a + h) / (a + b + h + p),
        "a constant": lambda _h, _p: hit_share,
    }
    for name, of in ways.items():
        told = [(of(*ours[cell]), hit) for cell, hit in events]
        losses = [-math.log(np.clip(q if hit else 1 - q, 1e-9, 1 - 1e-9)) for q, hit in told]
        assert found.of[name].log_loss == pytest.approx(np.mean(losses), rel=1e-6)
        sure = [(q, hit) for q, hit in told if q < 0.01]
        assert found.of[name].sure_free[2] == len(sure)
        if sure:
            assert found.of[name].sure_free[:2] == pytest.approx(tuple(np.mean(sure, axis=0)))
        assert found.of[name].reliability.count.sum() == len(events)
    worse = found.of["a constant"].log_loss < found.of["log odds"].log_loss
    assert found.log_odds_fail == worse


def test_cells_that_are_hit_now_and_then_are_where_log_odds_fail() -> None:
    ours = {(x, 0): (60, 140) for x in range(20)} | {(x, 1): (0, 90) for x in range(20)}
    found = scored(ours, ours)
    assert found.log_odds_fail
    assert found.of["calibrated"].log_loss < found.of["a constant"].log_loss


def test_maps_that_do_not_go_together() -> None:
    grid = map_of({(0, 0): (1, 1)})
    for other, what in ((EvidenceMap(0.2), "resolution"), (EvidenceMap(0.1, ndim=3), "ndim"),
                        (EvidenceMap(0.1, votes="beam"), "votes")):  # fmt: skip
        with pytest.raises(InputError, match=f"a map of the same {what}"):
            score_reflection(grid, other)
