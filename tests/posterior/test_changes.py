# SPDX-License-Identifier: Apache-2.0
"""Two periods compared: against the sum over the four pairs of states, and in simulation."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import EvidenceMap, LogOdds, VoxelMap, changed
from oddsmap.errors import ConfigError, InputError
from oddsmap.posterior.prior import PriorArray
from tests.kit import ONE, Votes, add_votes

few = st.integers(0, 12)
probability = st.floats(0.01, 0.99)


def view(votes: Votes, **options: Any) -> LogOdds:
    evidence = EvidenceMap(0.5)
    add_votes(evidence, votes)
    return evidence.log_odds(p_hit=0.8, p_miss=0.3, **options)


def by_enumeration(
    first: tuple[int, int], second: tuple[int, int], prior: float, change: float
) -> float:
    """Bayes' rule on the four pairs, with likelihoods multiplied reading by reading."""
    # p(z | m) of a hit and of a pass, up to a factor: their ratio is the Bayes factor.
    hit, free = {1: 0.8, 0: 0.2}, {1: 0.3, 0: 0.7}
    weights = {}
    for m1, m2 in itertools.product((0, 1), repeat=2):
        weight = (prior if m1 else 1.0 - prior) * (1.0 - change if m1 == m2 else change)
        for m, (hits, passes) in ((m1, first), (m2, second)):
            weight *= hit[m] ** hits * free[m] ** passes
        weights[m1, m2] = weight
    return (weights[0, 1] + weights[1, 0]) / sum(weights.values())


@given(st.tuples(few, few), st.tuples(few, few), probability, probability)
def test_against_enumeration(
    first: tuple[int, int], second: tuple[int, int], prior: float, change: float
) -> None:
    before = view({(3, 4): (first[0] * ONE, first[1] * ONE)}, prior=prior)
    after = view({(3, 4): (second[0] * ONE, second[1] * ONE)}, prior=prior)
    got = changed(before, after, p_change=change)
    if not (any(first) and any(second)):
        assert len(got.index) == 0
        return
    assert got.index.tolist() == [[3, 4]]
    assert got.probability.item() == pytest.approx(by_enumeration(first, second, prior, change))


def test_a_prior_of_each_cell_and_models_of_their_own() -> None:
    prior = PriorArray(np.array([[0.1, 0.5, 0.9]]), (0, 0))
    votes: Votes = {(0, 0): (2 * ONE, 0), (1, 0): (2 * ONE, 0), (2, 0): (2 * ONE, 0)}
    after: Votes = dict.fromkeys(votes, (0, 3 * ONE))
    got = changed(
        view(votes, prior=prior), view(after, prior=prior), p_change=0.2
    )  # fmt: skip
    want = [by_enumeration((2, 0), (0, 3), p, 0.2) for p in (0.1, 0.5, 0.9)]
    assert np.allclose(got.probability, want)
    # A clamp bounds what is shown, not what was seen.
    tight = changed(
        view(votes, prior=prior, clamp=(0.4, 0.6)), view(after, prior=prior), p_change=0.2
    )  # fmt: skip
    assert np.array_equal(tight.probability, got.probability)


@pytest.mark.parametrize("count", [10**3, 10**9])
def test_overwhelming_evidence(count: int) -> None:
    many, none = count * ONE, 0
    cells: Votes = {(0, 0): (many, none), (1, 0): (none, many), (2, 0): (many, none),
                    (3, 0): (none, many), (4, 0): (many, none), (5, 0): (many, many)}  # fmt: skip
    later: Votes = {(0, 0): (many, none), (1, 0): (none, many), (2, 0): (none, many),
                    (3, 0): (many, none), (4, 0): (none, ONE), (5, 0): (ONE, none)}  # fmt: skip
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        p = changed(view(cells), view(later)).probability
    assert p[:4] == pytest.approx([0.0, 0.0, 1.0, 1.0], abs=1e-50)
    assert p[4] == pytest.approx(0.1 * 0.7 / (0.1 * 0.7 + 0.9 * 0.3))  # one pass against a wall


def test_cells_seen_in_both_periods() -> None:
    before = view({(-7, 2): (ONE, 0), (40, 2): (ONE, 0), (1, 1): (0, ONE)})
    after = view({(40, 2): (0, ONE), (1, 1): (0, ONE), (-7, 3): (0, ONE)})
    got = changed(before, after)
    assert got.index.tolist() == [[1, 1], [40, 2]]
    grid = got.to_probability_map()
    assert grid.origin == (0.5, 0.5)
    assert grid.probability.shape == (2, 40)
    assert np.argwhere(grid.observed).tolist() == [[0, 0], [1, 39]]
    assert [grid.probability[0, 0], grid.probability[1, 39]] == got.probability.tolist()
    assert grid.probability[~grid.observed].max() == 0.0
    assert np.array_equal(changed(after, before).probability, got.probability)  # prior 1/2


def test_calibration() -> None:
    """Worlds drawn from the model: of the cells with P(changed) near p, a share p has changed."""
    rng = np.random.default_rng(11)
    n, prior, change = 60_000, 0.3, 0.15
    first = rng.random(n) < prior
    second = first ^ (rng.random(n) < change)
    views = []
    for state in (first, second):
        # P(hit | m) of 8/11 and 2/11: a hit's Bayes factor is 4, as of p_hit 0.8, a pass's 1/3.
        p_hit_given = np.where(state, 8 / 11, 2 / 11)
        trials = rng.integers(1, 4, n)
        hits = rng.binomial(trials, p_hit_given)
        evidence = EvidenceMap(1.0)
        index = np.stack([np.arange(n) % 300, np.arange(n) // 300], axis=1)
        evidence.add_cells(index, hits * ONE, (trials - hits) * ONE)
        views.append(evidence.log_odds(p_hit=0.8, p_miss=0.25, prior=prior))
    got = changed(*views, p_change=change).probability
    truth = first != second
    edges = np.quantile(got, np.linspace(0, 1, 9))
    for low, high in itertools.pairwise(edges):
        some = (got >= low) & (got <= high)
        share = float(truth[some].mean())
        assert share == pytest.approx(float(got[some].mean()), abs=4 * math.sqrt(0.25 / some.sum()))


def test_space() -> None:
    maps = [EvidenceMap(0.2, ndim=3) for _ in range(2)]
    for evidence, votes in zip(maps, ((3 * ONE, 0), (0, 9 * ONE)), strict=True):
        add_votes(evidence, {(1, 2, 3): votes})
    got = changed(maps[0].log_odds(), maps[1].log_odds())
    assert got.index.tolist() == [[1, 2, 3]]
    assert got.probability.item() > 0.5
    with pytest.raises(InputError, match="needs 2D cells"):
        got.to_probability_map()
    assert VoxelMap(got.index, np.zeros(1), got.resolution).leaf_count == 1


def test_wrong_requests() -> None:
    some = view({(0, 0): (ONE, 0)})
    for wrong in (0.0, 1.0, math.nan):
        with pytest.raises(ConfigError, match="p_change is a probability"):
            changed(some, view({}), p_change=wrong)
    with pytest.raises(InputError, match="different resolution"):
        changed(some, EvidenceMap(0.25).log_odds())
    with pytest.raises(InputError, match="different ndim"):
        changed(some, EvidenceMap(0.5, ndim=3).log_odds())
    with pytest.raises(InputError, match="different priors"):
        changed(some, view({(0, 0): (ONE, 0)}, prior=0.4))
    with pytest.raises(InputError, match="nothing to compare"):
        changed(some, view({})).to_probability_map()


def test_calibrated_views_give_their_bayes_factors() -> None:
    """Each period's factor is that of its own fit; the prior of both has to be one."""
    maps = [EvidenceMap(0.5), EvidenceMap(0.5)]
    counts = ([(0, 30), (0, 20), (9, 4), (7, 1)], [(0, 25), (8, 5), (0, 40), (6, 2)])
    for grid, rows in zip(maps, counts, strict=True):
        add_votes(grid, {(i, 0): (h * ONE, p * ONE) for i, (h, p) in enumerate(rows)})
    before, after = (grid.calibrated(prior=0.2) for grid in maps)
    got = changed(before, after, p_change=0.3)
    for i, (first, second) in enumerate(zip(*counts, strict=True)):
        weights = {}
        for m1, m2 in itertools.product((0, 1), repeat=2):
            weight = (0.2 if m1 else 0.8) * (0.7 if m1 == m2 else 0.3)
            weight *= math.exp(m1 * float(before.increment(*first)))
            weights[m1, m2] = weight * math.exp(m2 * float(after.increment(*second)))
        expected = (weights[0, 1] + weights[1, 0]) / sum(weights.values())
        assert got.probability[i] == pytest.approx(expected)
    assert changed(before, maps[1].log_odds(prior=0.2)).probability.shape == (4,)
    with pytest.raises(InputError, match="different priors: give both views the same"):
        changed(maps[0].calibrated(), maps[1].calibrated())
