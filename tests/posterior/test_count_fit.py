# SPDX-License-Identifier: Apache-2.0
"""Fits to counts: against SciPy's distributions, and against worlds drawn from the model."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import betabinom

from oddsmap import EvidenceMap
from oddsmap.array_types import FloatArray
from oddsmap.posterior.cell_classes import CellClasses, log_beta_binomial
from oddsmap.posterior.count_fit import CONCENTRATIONS, fit_beta, fit_classes
from oddsmap.posterior.count_pairs import CountPairs, count_pairs
from tests.kit import ONE, add_votes

KINDS = CellClasses((0.005, 0.1, 0.65), CONCENTRATIONS, (0.85, 0.08, 0.07))


def drawn(kinds: CellClasses, count: int, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hits and passes of cells of some kinds, and which are occupied."""
    rng = np.random.default_rng(seed)
    kind = rng.choice(3, count, p=kinds.share)
    total = np.array(kinds.concentration)[kind]
    mean = np.array(kinds.mean)[kind]
    reflectivity = rng.beta(mean * total, (1.0 - mean) * total)
    beams = rng.integers(1, 60, count)
    hits = rng.binomial(beams, reflectivity)
    return hits.astype(float), (beams - hits).astype(float), kind == 2


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
        fits.append((fit_beta(pairs), fit_classes(pairs)))
    assert fits[0] == fits[1] == fits[2]


def test_beta_binomial_of_one_order() -> None:
    for h, p, a, b in ((0.0, 0.0, 0.2, 3.0), (3.0, 5.0, 0.2, 3.0), (100.0, 1.0, 2.0, 0.5)):
        want = betabinom.logpmf(h, h + p, a, b) - np.log(_orders(int(h), int(p)))
        got = log_beta_binomial(np.array([h]), np.array([p]), a, b)
        assert np.allclose(got, want, rtol=1e-9, atol=1e-9)


def _orders(h: int, p: int) -> float:
    from math import comb

    return comb(h + p, h)


def test_the_beta_prior_is_found_again() -> None:
    rng = np.random.default_rng(1)
    reflectivity = rng.beta(0.05, 0.8, 200_000)
    hits = rng.binomial(30, reflectivity).astype(float)
    alpha, beta = fit_beta(pairs_of(hits, 30.0 - hits))
    assert alpha == pytest.approx(0.05, rel=0.03)
    assert beta == pytest.approx(0.8, rel=0.05)


def test_kinds_of_cells_are_found_again() -> None:
    hits, passes, occupied = drawn(KINDS, 200_000, 2)
    found = fit_classes(pairs_of(hits, passes))
    assert found.occupied_share == pytest.approx(0.07, abs=0.01)
    assert found.mean[0] == pytest.approx(0.005, abs=0.002)
    assert found.mean[2] == pytest.approx(0.65, abs=0.03)
    # And what is said of single cells is as true as it can be.
    prior = np.log(found.occupied_share / (1.0 - found.occupied_share))
    p = 1.0 / (1.0 + np.exp(-found.log_bayes_factor(hits, passes) - prior))
    for low, high in ((0.0, 0.1), (0.1, 0.4), (0.4, 0.7), (0.7, 0.9), (0.9, 1.0)):
        cells = (p >= low) & (p < high)
        assert abs(p[cells].mean() - occupied[cells].mean()) < 0.06, (low, high)


def test_no_neighbour_of_a_fit_is_better() -> None:
    hits, passes, _ = drawn(KINDS, 20_000, 3)
    pairs = pairs_of(hits, passes)
    found = fit_classes(pairs)

    def log_p(kinds: CellClasses) -> float:
        each = [
            np.log(share) + log_beta_binomial(pairs.hits, pairs.passes, m * c, (1.0 - m) * c)
            for m, c, share in zip(kinds.mean, kinds.concentration, kinds.share, strict=True)
        ]
        return float(pairs.cells @ np.logaddexp.reduce(np.stack(each), axis=0))

    best = log_p(found)
    for kind in range(3):
        for factor in (0.8, 1.2):
            mean = list(found.mean)
            mean[kind] *= factor
            assert log_p(CellClasses((*mean,), found.concentration, found.share)) < best  # type: ignore[arg-type]
    for i, j in ((0, 2), (2, 1)):
        share = list(found.share)
        moved = 0.2 * share[i]
        share[i], share[j] = share[i] - moved, share[j] + moved
        assert log_p(CellClasses(found.mean, found.concentration, (*share,))) < best  # type: ignore[arg-type]


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
    found = fit_classes(pairs)
    assert sum(found.share) == pytest.approx(1.0)
    assert min(found.share) > 0.0
    assert found.mean[0] <= found.mean[2]
    factor = found.log_bayes_factor(np.array([0.0, 3.0, 0.0]), np.array([0.0, 0.0, 3.0]))
    assert factor[0] == 0.0
    assert factor[2] < 0.0 < factor[1]
