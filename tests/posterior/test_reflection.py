# SPDX-License-Identifier: Apache-2.0
"""The Beta posterior of each cell: its closed form, its calibration, and what it is drawn as."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import EvidenceMap, Reflection, State, load_ros
from oddsmap.errors import ConfigError, InputError
from oddsmap.posterior.reflection import IntervalKind
from tests.kit import ONE, add_votes

CELL = ((0, 0), (1, 1))


def seen(hits: float, passes: float, **options: Any) -> Reflection:
    evidence = EvidenceMap(1.0, votes="beam")
    add_votes(evidence, {(0, 0): (round(hits * ONE), round(passes * ONE))})
    return evidence.reflection(**options)


def scene(seed: int = 0, ndim: int = 2) -> EvidenceMap:
    rng = np.random.default_rng(seed)
    index = np.unique(rng.integers(-9, 9, (80, ndim)), axis=0)
    evidence = EvidenceMap(0.5, votes="beam", ndim=ndim)
    evidence.add_cells(index, *(rng.integers(1, 90, (2, len(index))) * ONE // 2))
    return evidence


@given(st.text("hp", max_size=40), st.floats(1.0, 9.0), st.floats(1.0, 9.0))
def test_the_recursion_equals_the_closed_form(readings: str, a: float, b: float) -> None:
    """Bayes' rule reading by reading, on a grid of reflectivities, forwards and backwards."""
    m = (np.arange(4000) + 0.5) / 4000
    belief = scipy.stats.beta(a, b).logpdf(m)
    for reading in readings[::-1]:
        belief = belief + np.log(m if reading == "h" else 1.0 - m)
    weight = np.exp(belief - belief.max())
    view = seen(readings.count("h"), readings.count("p"), a=a, b=b)
    mean = float((weight * m).sum() / weight.sum())
    assert view.mean(CELL).item() == pytest.approx(mean, abs=1e-5)
    spread = math.sqrt(float((weight * (m - mean) ** 2).sum() / weight.sum()))
    assert view.std(CELL).item() == pytest.approx(spread, abs=1e-5)


@given(
    st.integers(0, 400), st.integers(0, 400), st.floats(0.2, 5.0), st.sampled_from([0.1, 0.5, 0.8])
)
def test_against_scipy(hits: int, passes: int, a: float, threshold: float) -> None:
    """Quarter votes: fractional counts, too."""
    view = seen(hits / 4, passes / 4, a=a, b=2.0, threshold=threshold, level=0.8)
    at = scipy.stats.beta(a + hits / 4, 2.0 + passes / 4)
    assert np.isclose(view.mean(CELL), at.mean())
    assert np.isclose(view.std(CELL), at.std())
    assert np.isclose(view.p_above(CELL), at.sf(threshold), rtol=1e-9, atol=1e-300)
    assert np.allclose(np.ravel(view.interval(CELL)), at.interval(0.8))
    assert np.allclose(np.ravel(view.interval(CELL, level=0.5)), at.interval(0.5))
    lower, upper = view.interval(CELL, kind="highest-density")
    assert (upper - lower).item() <= np.ptp(at.interval(0.8)) + 1e-12


def test_unseen_cells_have_the_prior() -> None:
    view = EvidenceMap(1.0, votes="beam").reflection(a=2.0, b=6.0)
    region = ((3, 3), (5, 4))
    prior = scipy.stats.beta(2.0, 6.0)
    assert view.mean(region).tolist() == [[0.25, 0.25]]
    assert view.mode(region).tolist() == [[pytest.approx(1 / 6)] * 2]
    assert np.allclose(view.std(region), prior.std())
    assert np.allclose([end[0, 0] for end in view.interval(region)], prior.interval(0.95))
    assert not view.observed(region).any()
    assert (view.state(region) == State.UNKNOWN).all()
    assert view.mean().shape == view.interval()[0].shape == view.p_above().shape == (0, 0)
    assert view.state().shape == (0, 0)


def test_regions_and_cells() -> None:
    for ndim in (2, 3):
        view = scene(1, ndim).reflection()
        index, alpha, beta = view.cells()
        lo = np.array([-10] * ndim)
        mean, mode = (f((lo, -lo)) for f in (view.mean, view.mode))
        lower, upper = view.interval((lo, -lo))
        at = tuple((index - lo).T[::-1])
        assert np.allclose(mean[at], alpha / (alpha + beta))
        assert np.allclose(mode[at], (alpha - 1) / (alpha + beta - 2))
        assert np.allclose(lower[at], scipy.stats.beta(alpha, beta).ppf(0.025))
        assert np.allclose(upper[at], scipy.stats.beta(alpha, beta).ppf(0.975))
        assert np.array_equal(view.mean(), view.mean(view.evidence.bounds()))
        assert np.count_nonzero(view.observed((lo, -lo))) == len(index)


def test_it_follows_the_map() -> None:
    view = seen(1, 0)
    assert view.mean().item() == pytest.approx(2 / 3)
    add_votes(view.evidence, {(0, 0): (0, ONE)})
    assert view.mean().item() == 0.5


def test_states() -> None:
    evidence = EvidenceMap(1.0, votes="beam")
    add_votes(evidence, {(0, 0): (20 * ONE, 0), (1, 0): (0, 20 * ONE), (2, 0): (ONE, ONE),
                         (4, 0): (8 * ONE, 20 * ONE)})  # fmt: skip
    view = evidence.reflection()
    assert view.state()[0].tolist() == [100, 0, 50, -1, 0]
    # Glass: reflects a quarter of the beams, which log odds would call free without a doubt.
    low = evidence.reflection(threshold=0.1)
    assert low.state()[0].tolist() == [100, 50, 50, -1, 100]
    wide = evidence.reflection(level=0.9999)
    assert wide.state()[0].tolist() == [100, 0, 50, -1, 50]


@pytest.mark.parametrize("kind", ["equal-tailed", "highest-density"])
@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (0.7, 2.5)])
def test_calibration(kind: IntervalKind, a: float, b: float) -> None:
    """Reflectivities drawn from the prior lie in 50, 80 and 95 % of the intervals of that level."""
    rng = np.random.default_rng(7)
    side = 140
    trials = rng.integers(1, 60, side * side)
    truth = rng.beta(a, b, side * side)
    hits = rng.binomial(trials, truth)
    index = np.stack([np.arange(side * side) % side, np.arange(side * side) // side], axis=1)
    evidence = EvidenceMap(1.0, votes="beam")
    evidence.add_cells(index, hits * ONE, (trials - hits) * ONE)
    view = evidence.reflection(a=a, b=b, kind=kind)
    m = truth.reshape(side, side)
    for level in (0.5, 0.8, 0.95):
        lower, upper = view.interval(((0, 0), (side, side)), level=level)
        assert abs(float(((m >= lower) & (m <= upper)).mean()) - level) < 0.03
    # P(m > 0.5) is calibrated, too: among cells with p around 0.7, 70 % lie above.
    p = view.p_above(((0, 0), (side, side)))
    some = (p > 0.6) & (p < 0.8)
    assert some.sum() > 300
    assert abs(float((m[some] > 0.5).mean()) - float(p[some].mean())) < 0.05
    # The mean's error is what the standard deviation says.
    error = (view.mean(((0, 0), (side, side))) - m) / view.std(((0, 0), (side, side)))
    assert abs(float(np.mean(error**2)) - 1.0) < 0.05


def test_monte_carlo() -> None:
    """The conditional distribution itself: of many worlds, those that gave 3 of 10."""
    rng = np.random.default_rng(3)
    m = rng.random(2_000_000)
    m = m[rng.binomial(10, m) == 3]
    view = seen(3, 7)
    assert view.mean().item() == pytest.approx(float(m.mean()), abs=2e-3)
    assert view.std().item() == pytest.approx(float(m.std()), abs=2e-3)
    assert np.allclose(np.ravel(view.interval()), np.quantile(m, [0.025, 0.975]), atol=4e-3)
    assert view.p_above().item() == pytest.approx(float((m > 0.5).mean()), abs=3e-3)


def test_votes_of_scans_are_warned_of() -> None:
    with pytest.warns(UserWarning, match='build the map with votes="beam"'):
        Reflection(EvidenceMap(1.0, votes="scan"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Reflection(EvidenceMap(1.0, votes="beam"))


def test_npz(tmp_path: Path) -> None:
    view = scene().reflection(kind="highest-density", level=0.8, a=0.5)
    view.save_npz(tmp_path / "m.npz")
    index, hits, passes = view.evidence.cells()
    region = view.evidence.bounds()
    assert region is not None
    at = tuple((index - region[0]).T[::-1])
    with np.load(tmp_path / "m.npz") as arrays:
        assert np.array_equal(arrays["index"], index)
        assert np.array_equal(arrays["hits"], hits / ONE)
        assert np.array_equal(arrays["passes"], passes / ONE)
        assert arrays["observed"].all()
        assert arrays["resolution"] == 0.5
        assert np.array_equal(arrays["probability"], view.mean()[at].astype(np.float32))
        assert np.array_equal(arrays["std"], view.std()[at].astype(np.float32))
        for name, end in zip(("lower", "upper"), view.interval(), strict=True):
            assert np.array_equal(arrays[name], end[at].astype(np.float32))


def test_ros(tmp_path: Path) -> None:
    view = scene().reflection()
    for mode in ("scale", "raw"):
        view.save_ros(tmp_path / f"{mode}.yaml", mode=mode)
        back = load_ros(tmp_path / f"{mode}.yaml")
        assert np.array_equal(back.observed, view.observed())
        assert np.allclose(back.probability[back.observed], view.mean()[back.observed], atol=0.0051)
        assert back.origin == view.to_probability_map().origin
    with pytest.raises(ConfigError, match="not a state"):
        view.save_ros(tmp_path / "t.yaml", mode="trinary")


def test_space_has_no_picture(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"write its reflectivity as \.npz"):
        scene(0, 3).reflection().save_png(tmp_path / "m.png")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"a": 0.0}, "prior's a is a weight"),
        ({"b": math.inf}, "prior's b is a weight"),
        ({"a": math.nan}, "prior's a is a weight"),
        ({"threshold": 1.0}, "threshold lies between"),
        ({"level": 0.0}, "level lies between"),
        ({"kind": "hdi"}, "equal-tailed or highest-density"),
    ],
)
def test_bad_values(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        seen(1, 1, **options)
    with pytest.raises(ConfigError, match="threshold lies between"):
        seen(1, 1).p_above(threshold=-0.1)
    with pytest.raises(ConfigError, match="not a quantity; known: mean, mode"):
        seen(1, 1).quantity("median")  # type: ignore[arg-type]
