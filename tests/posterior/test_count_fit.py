# SPDX-License-Identifier: Apache-2.0
"""Fits to counts: against SciPy's distributions, and against worlds drawn from the model."""

from __future__ import annotations

from collections import Counter

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import betaln

from oddsmap import EvidenceMap
from oddsmap.array_types import FloatArray
from oddsmap.posterior import count_fit
from oddsmap.posterior.count_fit import fit_beta, fit_model
from oddsmap.posterior.count_model import KNOTS, CountModel, occupied_at
from oddsmap.posterior.count_pairs import CountPairs, count_pairs, few_pairs
from tests.kit import ONE, add_votes
from tests.naive import counts as naive


def drawn(count: int, seed: int) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Hits and passes of cells, and which are occupied; few beams enter walls."""
    rng = np.random.default_rng(seed)
    few = rng.random(count) < 0.3
    wall = rng.random(count) < np.where(few, 0.4, 0.05)
    r = np.where(wall, rng.beta(4.0, 3.0, count), rng.beta(0.3, 12.0, count))
    occupied = rng.random(count) < np.interp(r, naive.GRID, occupied_at())
    beams = np.where(few, rng.integers(1, 5, count), rng.integers(20, 200, count))
    hits = rng.binomial(beams, r)
    return hits.astype(float), (beams - hits).astype(float), occupied


def pairs_of(hits: FloatArray, passes: FloatArray) -> CountPairs:
    found = Counter(zip(hits.tolist(), passes.tolist(), strict=True))
    keys = sorted(found)
    array = np.array(keys).reshape(-1, 2)
    return CountPairs(array[:, 0], array[:, 1], np.array([float(found[key]) for key in keys]))


@given(
    st.lists(
        st.tuples(st.integers(-40, 40), st.integers(-40, 40), st.integers(0, 600 * ONE),
                  st.integers(0, 600 * ONE) | st.just(3 * ONE)),
        max_size=40, unique_by=lambda row: row[:2],
    )
)  # fmt: skip
@settings(max_examples=40)
def test_pairs_are_those_of_the_cells(rows: list[tuple[int, int, int, int]]) -> None:
    grid = EvidenceMap(0.1)
    add_votes(grid, {(x, y): (h, p) for x, y, h, p in rows if h + p})
    pairs = count_pairs(grid)
    want = Counter((h / ONE, p / ONE) for _, _, h, p in rows if h + p)
    assert list(zip(pairs.hits, pairs.passes, strict=True)) == sorted(want)
    assert pairs.cells.tolist() == [want[key] for key in sorted(want)]


def test_the_order_of_cells_and_their_tiles_change_no_bit() -> None:
    rng = np.random.default_rng(0)
    votes = {
        (int(x), int(y)): (int(h) * ONE, int(p) * ONE)
        for x, y, h, p in zip(*rng.integers(0, 300, (4, 500)), strict=True)
        if h + p
    }
    fits = []
    for side, reverse in ((None, False), (5, True), (100, False)):
        grid = EvidenceMap(0.1, tile_side=side)
        add_votes(grid, dict(sorted(votes.items(), reverse=reverse)))
        pairs = count_pairs(grid)
        fits.append((fit_beta(pairs), fit_model(pairs)))
    assert fits[0] == fits[1] == fits[2]


def test_the_beta_prior_is_found_again() -> None:
    rng = np.random.default_rng(1)
    reflectivity = rng.beta(0.05, 0.8, 200_000)
    hits = rng.binomial(30, reflectivity).astype(float)
    alpha, beta = fit_beta(pairs_of(hits, 30.0 - hits))
    assert alpha == pytest.approx(0.05, rel=0.03)
    assert beta == pytest.approx(0.8, rel=0.05)


@given(
    cells=st.lists(
        st.tuples(st.integers(0, 40) | st.just(0.25), st.integers(0, 40), st.integers(1, 10**6)),
        min_size=1,
        max_size=8,
    )
)
@settings(max_examples=40, deadline=None)
def test_no_beta_prior_is_better_than_the_fitted_one(cells: list[tuple[float, int, int]]) -> None:
    """Of 9 x 9 around it, near and far, with SciPy's distribution; it is the only optimum."""
    hits, passes, count = np.array([c for c in cells if c[0] + c[1]] or [(1, 0, 1)], float).T

    def log_p(alpha: FloatArray, beta: FloatArray) -> FloatArray:
        rise = betaln(alpha[..., None] + hits, beta[..., None] + passes)
        rise -= betaln(alpha, beta)[..., None]
        off = np.log(alpha / count_fit.BETA[0]) ** 2 + np.log(beta / count_fit.BETA[1]) ** 2
        return np.asarray((rise * count).sum(axis=-1) - off / (2.0 * count_fit._PRIOR_SD**2))

    found = np.array(fit_beta(CountPairs(hits, passes, count)))
    best = log_p(*found)
    for step in (0.001, 0.1, 1.0, 3.0):
        factors = np.exp(np.arange(-4, 5) * step)
        a, b = (np.clip(x * factors, 1e-4, 1e3) for x in found)
        others = log_p(*np.meshgrid(a, b))
        # As exactly as differences of gamma functions of a thousand are known.
        assert others.max() <= best + 1e-9 * count.sum()


def test_the_fit_is_that_of_the_oracle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(count_fit, "_STEPS", 5)
    cells = [(0, 1), (1, 0), (0, 9), (0, 9), (3, 4), (12, 0), (2, 190), (0.5, 0.25), (0, 300)]
    found = fit_model(pairs_of(*np.array(cells, float).T))
    want = naive.fitted(cells, 5)
    assert np.allclose(found.distributions, want, rtol=1e-9, atol=1e-15)


@given(st.lists(st.tuples(st.integers(0, 60), st.integers(0, 60)), min_size=1, max_size=12))
@settings(max_examples=25, deadline=None)
def test_what_is_said_of_a_cell_is_the_oracle_s(cells: list[tuple[int, int]]) -> None:
    found = fit_model(pairs_of(*np.array(cells, float).T))
    share = found.occupied_share
    for h, p in cells:
        factor = float(found.log_bayes_factor(h, p))
        if h + p == 0:
            assert factor == 0.0
            continue
        got = 1.0 / (1.0 + np.exp(-factor) * (1.0 - share) / share)
        assert got == pytest.approx(naive.p_occupied(found.distributions, h, p), rel=1e-7)


def test_what_is_said_of_cells_is_true() -> None:
    hits, passes, occupied = drawn(200_000, 2)
    found = fit_model(pairs_of(hits, passes))
    prior = np.log(found.occupied_share / (1.0 - found.occupied_share))
    p = 1.0 / (1.0 + np.exp(-found.log_bayes_factor(hits, passes) - prior))
    # Up to four beams tell some moments of a distribution, not all of it.
    for low, high, off in ((0.0, 0.1, 0.003), (0.1, 0.5, 0.1), (0.5, 0.9, 0.1), (0.9, 1.0, 0.01)):
        cells = (p >= low) & (p < high)
        assert abs(p[cells].mean() - occupied[cells].mean()) < off, (low, high)
    # Also of those that few beams entered, of which more are occupied than of all.
    unhit = (hits == 0.0) & (passes == 1.0)
    assert p[unhit].mean() == pytest.approx(occupied[unhit].mean(), abs=0.05)


def test_evidence_that_fades_away_ends_in_the_prior() -> None:
    hits, passes, _ = drawn(5_000, 4)
    found = fit_model(pairs_of(hits, passes))
    assert float(found.log_bayes_factor(1e-9, 0.0)) == pytest.approx(0.0, abs=1e-6)
    assert found.log_bayes_factor(np.zeros((2, 3)), 0.0).tolist() == [[0.0] * 3] * 2


def test_many_pairs_are_rounded_and_say_the_same() -> None:
    rng = np.random.default_rng(5)
    hits, passes = rng.integers(0, 3000, (2, 60_000)) * rng.random((2, 60_000)) ** 4
    pairs = pairs_of(hits, passes)
    few = few_pairs(pairs)
    assert len(pairs.cells) > 50_000
    assert len(few.cells) <= 10_000
    assert few.cells.sum() == pairs.cells.sum()
    assert few.hits @ few.cells == pytest.approx(hits.sum(), rel=0.02)
    whole = pairs_of(np.array([0.0, 3.0, 300.0]), np.array([7.0, 1.0, 1.0]))
    assert few_pairs(whole) is whole


@pytest.mark.parametrize(
    ("hits", "passes"),
    [([], []), ([1.0], [0.0]), ([0.0] * 50, [3.0] * 50), ([4.0] * 50, [0.0] * 50),
     ([1e9] * 9, [1e9] * 9), ([0.25, 0.5], [0.125, 7.5])],
)  # fmt: skip
def test_counts_that_say_little_are_no_trouble(hits: list[float], passes: list[float]) -> None:
    pairs = pairs_of(np.array(hits), np.array(passes))
    alpha, beta = fit_beta(pairs)
    assert 0.0 < alpha < np.inf
    assert 0.0 < beta < np.inf
    found = fit_model(pairs)
    assert len(found.distributions) == KNOTS
    assert np.sum(found.distributions, axis=1) == pytest.approx(np.ones(KNOTS))
    assert np.min(found.distributions) > 0.0
    assert isinstance(found, CountModel)
    factor = found.log_bayes_factor(np.array([0.0, 3.0, 0.0]), np.array([0.0, 0.0, 3.0]))
    assert factor[0] == 0.0
    assert factor[2] < 0.0 < factor[1]
