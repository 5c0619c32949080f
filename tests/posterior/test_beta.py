# SPDX-License-Identifier: Apache-2.0
"""Modes and intervals against SciPy's distribution and a dense numerical oracle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.errors import ConfigError
from oddsmap.posterior.beta import beta_interval, beta_mode

FloatArray = npt.NDArray[np.float64]

# Whole and fractional counts, from none to very many.
shape = st.one_of(
    st.integers(1, 4000).map(lambda n: n / 4.0), st.floats(0.05, 1.0), st.floats(1.0, 1e5)
)
level = st.sampled_from([0.5, 0.8, 0.95, 0.999])


def one(value: float) -> FloatArray:
    return np.array([value])


def shortest(alpha: float, beta: float, mass: float) -> tuple[float, float]:
    """The slow way: of many intervals of that mass, the shortest."""
    at = scipy.stats.beta(alpha, beta)
    below = np.linspace(0.0, 1.0 - mass, 20_001)
    lower = at.ppf(below)
    upper = at.ppf(np.minimum(below + mass, 1.0))
    best = int(np.argmin(upper - lower))
    return float(lower[best]), float(upper[best])


@given(shape, shape, level)
def test_equal_tails(alpha: float, beta: float, mass: float) -> None:
    lower, upper = beta_interval(one(alpha), one(beta), mass)
    want = scipy.stats.beta(alpha, beta).interval(mass)
    assert np.allclose([lower[0], upper[0]], want, rtol=1e-9, atol=1e-12)


# Below 1/2 much of the mass lies within one digit of 1: no number there has the level below it.
@given(shape.filter(lambda x: x >= 0.5), shape.filter(lambda x: x >= 0.5), level)
def test_the_mass_is_the_level_for_both_kinds(alpha: float, beta: float, mass: float) -> None:
    at = scipy.stats.beta(alpha, beta)
    lower, upper = beta_interval(one(alpha), one(beta), mass, "highest-density")
    assert 0.0 <= lower[0] < upper[0] <= 1.0
    assert at.cdf(upper[0]) - at.cdf(lower[0]) == pytest.approx(mass, abs=3e-8)
    tails = beta_interval(one(alpha), one(beta), mass)
    if max(alpha, beta) > 1.0:
        assert upper[0] - lower[0] <= (tails[1] - tails[0])[0] + 1e-12


@given(st.floats(1.01, 400.0), st.floats(1.01, 400.0), level)
def test_ends_of_the_shortest_are_equally_dense(alpha: float, beta: float, mass: float) -> None:
    lower, upper = beta_interval(one(alpha), one(beta), mass, "highest-density")
    at = scipy.stats.beta(alpha, beta)
    scale = float(at.pdf(beta_mode(one(alpha), one(beta)))[0])
    # An end may lie so near 0 or 1 that the density changes by more than this within a digit.
    if lower[0] > 1e-9 and upper[0] < 1 - 1e-9:
        assert abs(at.pdf(lower[0]) - at.pdf(upper[0])) < 1e-6 * scale


@pytest.mark.parametrize("mass", [0.5, 0.8, 0.95])
@pytest.mark.parametrize(
    ("alpha", "beta"),
    [(2, 2), (2, 9), (30, 4), (1.001, 3), (3, 1.0001), (1, 5), (7, 1), (0.5, 3), (4, 0.3),
     (1, 0.5), (0.5, 1), (700, 300), (1.5, 1e4), (31.25, 0.9)],
)  # fmt: skip
def test_shortest_of_many(alpha: float, beta: float, mass: float) -> None:
    lower, upper = beta_interval(one(alpha), one(beta), mass, "highest-density")
    want = shortest(alpha, beta, mass)
    # The width is flat around its least, so the oracle's ends are coarser than its width.
    assert upper[0] - lower[0] == pytest.approx(want[1] - want[0], rel=1e-5)
    assert np.allclose([lower[0], upper[0]], want, atol=2e-3 * (want[1] - want[0]))
    assert upper[0] - lower[0] <= want[1] - want[0] + 1e-12


def test_where_none_is_shortest() -> None:
    for alpha, beta in ((1.0, 1.0), (0.5, 0.5), (0.2, 0.9)):
        tails = beta_interval(one(alpha), one(beta), 0.9)
        assert beta_interval(one(alpha), one(beta), 0.9, "highest-density") == tails
    lower, upper = beta_interval(one(1.0), one(1.0), 0.9)
    assert (lower[0], upper[0]) == (pytest.approx(0.05), pytest.approx(0.95))


def test_many_at_once_are_as_one_by_one() -> None:
    rng = np.random.default_rng(1)
    alpha, beta = rng.uniform(0.5, 60.0, (2, 300)) ** rng.uniform(0.2, 2.0, (2, 300))
    for kind in ("equal-tailed", "highest-density"):
        together = np.stack(beta_interval(alpha, beta, 0.9, kind))
        single = [
            np.stack(beta_interval(one(a), one(b), 0.9, kind))[:, 0]
            for a, b in zip(alpha, beta, strict=True)
        ]
        assert np.array_equal(together, np.transpose(single))


def test_very_many_counts() -> None:
    n = 1e9
    for kind in ("equal-tailed", "highest-density"):
        lower, upper = beta_interval(one(0.3 * n), one(0.7 * n), 0.95, kind)
        half = 1.959964 * np.sqrt(0.3 * 0.7 / n)
        assert np.allclose([lower[0], upper[0]], [0.3 - half, 0.3 + half], atol=1e-3 * half)


@given(st.floats(0.05, 50.0), st.floats(0.05, 50.0))
def test_modes_are_where_the_density_is_largest(alpha: float, beta: float) -> None:
    mode = beta_mode(one(alpha), one(beta))[0]
    if alpha < 1.0 and beta < 1.0:
        assert np.isnan(mode)
        return
    at = scipy.stats.beta(alpha, beta)
    x = np.linspace(0.0, 1.0, 2001)[1:-1]
    if alpha == beta == 1.0:
        assert np.isnan(mode)
        return
    # At 0 and 1 themselves the density may be infinite: the nearest place stands for them.
    near = float(np.clip(mode, x[0], x[-1]))
    assert at.logpdf(near) >= at.logpdf(x).max() - 1e-9


def test_modes_at_the_ends() -> None:
    alpha = np.array([1.0, 1.0, 3.0, 0.5, 2.0, 1.0, 0.5, 1.0, 0.5])
    beta = np.array([1.0, 3.0, 1.0, 2.0, 0.5, 0.5, 1.0, 2.0, 0.5])
    want = [np.nan, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, np.nan]
    assert np.array_equal(beta_mode(alpha, beta), want, equal_nan=True)
    assert beta_mode(one(3.0), one(2.0))[0] == pytest.approx(2 / 3)


def test_bad_values() -> None:
    for wrong in (0.0, 1.0, -1.0, float("nan")):
        with pytest.raises(ConfigError, match="level lies between 0 and 1"):
            beta_interval(one(2.0), one(2.0), wrong)
    with pytest.raises(ConfigError, match="equal-tailed or highest-density"):
        beta_interval(one(2.0), one(2.0), 0.9, "widest")  # type: ignore[arg-type]
