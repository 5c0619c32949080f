# SPDX-License-Identifier: Apache-2.0
"""The decay-rate view: against SciPy's Gamma distribution, and calibrated in simulated media."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import gamma

from oddsmap import BeamSensor, EvidenceMap, Pose2, Scan, add_scans, build_map
from oddsmap.errors import ConfigError, InputError
from oddsmap.posterior.decay_rate import DecayRate
from tests.kit import random_scans

FloatArray = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def evidence() -> EvidenceMap:
    return build_map(
        random_scans(1, 30), 0.25, sensor=BeamSensor(range_max=5.0), votes="beam", path_lengths=True
    )


def test_the_posterior_is_a_gamma_distribution(evidence: EvidenceMap) -> None:
    view = evidence.decay_rate(shape=2.5, rate=0.3, level=0.8)
    lo, hi = evidence.bounds() or (None, None)
    assert lo is not None
    assert hi is not None
    hits, _ = evidence.region(lo, hi)
    length = evidence.region_lengths(lo, hi)
    assert hits.max() > 3.0
    want = gamma(2.5 + hits, scale=1.0 / (0.3 + length))
    assert np.allclose(view.mean(), want.mean(), rtol=1e-12)
    assert np.allclose(view.std(), want.std(), rtol=1e-12)
    lower, upper = view.interval()
    assert np.allclose(lower, want.ppf(0.1), rtol=1e-9)
    assert np.allclose(upper, want.ppf(0.9), rtol=1e-9)
    assert np.allclose(view.interval(level=0.5)[1], want.ppf(0.75), rtol=1e-9)
    assert np.allclose(view.quantity("interval-width"), upper - lower)
    assert (view.quantity("lower") == lower).all()
    # The mode: no density nearby is higher.
    mode = view.mode()
    for other in (mode * 0.999, mode * 1.001):
        assert (want.logpdf(mode) >= want.logpdf(other)).all()


def test_points_have_the_mean_of_their_cells(evidence: EvidenceMap) -> None:
    view = evidence.decay_rate(shape=1.5)
    lo, hi = view.region_of((-3.0, -3.0), (3.0, 3.0))
    cells = np.stack(np.meshgrid(np.arange(lo[0], hi[0]), np.arange(lo[1], hi[1])), axis=-1)
    points = view.centre_of(cells.reshape(-1, 2)) + 0.1
    assert np.array_equal(view.at(points), view.mean((lo, hi)).ravel())
    assert view.at([[1e6, 0.0]]).tolist() == [1.5 / 0.25]


def test_the_chance_of_passing_is_an_expectation(evidence: EvidenceMap) -> None:
    view = evidence.decay_rate()
    index, shape, rate = view.cells()
    rng = np.random.default_rng(0)
    cells = np.argsort(shape)[-3:]
    for way in (0.25, 1.0):
        passed = view.p_pass(way=way)
        lo = (evidence.bounds() or (index, index))[0]
        for cell in cells:
            drawn = rng.gamma(shape[cell], 1.0 / rate[cell], 200_000)
            x, y = index[cell] - lo
            assert passed[y, x] == pytest.approx(np.exp(-drawn * way).mean(), abs=0.005)
    assert np.allclose(view.p_pass(), view.p_pass(way=0.25))
    assert (view.p_pass(way=0.0) == 1.0).all()


def test_unseen_cells_are_the_prior(evidence: EvidenceMap) -> None:
    view = evidence.decay_rate()
    away = ((1000, 1000), (1001, 1001))
    assert view.mean(away) == 1.0 / 0.25
    assert view.p_pass(away) == pytest.approx(0.5)
    assert not view.observed(away).any()
    assert evidence.decay_rate(shape=3.0, rate=2.0).mean(away) == 1.5


def test_cells_are_those_with_votes_or_a_length() -> None:
    # The cell where a no-return stops has a length and no vote; a return on the border of a cell
    # has a vote and no length.
    scan = Scan(Pose2(0.5, 0.5, 0.0), np.tile([1.0, 0.0], (2, 1)), np.array([1.5, math.inf]))
    evidence = EvidenceMap(
        1.0, votes="beam", sensor=BeamSensor(clear_range=2.75), path_lengths=True
    )
    add_scans(evidence, [scan])
    index, shape, rate = evidence.decay_rate(shape=1.0, rate=1.0).cells()
    assert index.tolist() == [[0, 0], [1, 0], [2, 0], [3, 0]]
    assert shape.tolist() == [1.0, 1.0, 2.0, 1.0]
    assert np.allclose(rate, [2.0, 3.0, 2.0, 1.25])
    assert evidence.decay_rate().observed().all()


def media(seed: int, rows: int, columns: int, beams: int) -> tuple[EvidenceMap, FloatArray]:
    """Beams along rows of cells of 0.5 m, each of a decay rate drawn from Gamma(2, 1 m).

    A beam ends where the integral of the rate reaches an exponential number.
    """
    rng = np.random.default_rng(seed)
    side, reach = 0.5, 4.0
    rates = rng.gamma(2.0, 1.0, (rows, columns))
    edges = np.arange(columns + 1) * side
    evidence = EvidenceMap(
        side, votes="beam", sensor=BeamSensor(range_max=reach), path_lengths=True
    )
    for row in range(rows):
        depth = np.concatenate([[0.0], np.cumsum(rates[row] * side)])
        start = rng.uniform(reach, edges[-1] - reach, beams)
        way = rng.choice([-1.0, 1.0], beams)
        optical = np.interp(start, edges, depth) + way * rng.exponential(size=beams)
        # Beams that would leave the row are longer than the sensor sees.
        ends = np.interp(optical, depth, edges)
        ranges = np.abs(ends - start)
        ranges[ranges >= reach] = np.inf
        scans = [
            Scan(Pose2(float(x), (row + 0.5) * side, 0.0), np.array([[w, 0.0]]), np.array([r]))
            for x, w, r in zip(start, way, ranges, strict=True)
        ]
        add_scans(evidence, scans)
    return evidence, rates


def test_intervals_are_calibrated_in_random_media() -> None:
    evidence, rates = media(0, rows=80, columns=60, beams=200)
    view = evidence.decay_rate(shape=2.0, rate=1.0)
    box = ((0, 0), (60, 80))
    seen = view.observed(box)
    assert seen.sum() > 3500
    for level in (0.5, 0.8, 0.95):
        lower, upper = view.interval(box, level=level)
        inside = (lower <= rates) & (rates <= upper)
        assert abs(inside[seen].mean() - level) < 0.03
    # And they are narrower than the prior's: the readings say something.
    prior = view.interval(((500, 500), (501, 501)), level=0.8)
    lower, upper = view.interval(box, level=0.8)
    assert np.median((upper - lower)[seen]) < 0.7 * float((prior[1] - prior[0])[0, 0])
    error = (view.mean(box) - rates)[seen]
    assert abs(error.mean()) < 4.0 * error.std() / math.sqrt(seen.sum())


def test_pictures_and_arrays(evidence: EvidenceMap, tmp_path: Path) -> None:
    view = evidence.decay_rate()
    view.save_png(tmp_path / "a.png")
    view.save_png(tmp_path / "b.png", show="p-pass")
    assert (tmp_path / "a.png").stat().st_size > 1000
    view.save_npz(tmp_path / "a.npz")
    index, shape, rate = view.cells()
    with np.load(tmp_path / "a.npz") as arrays:
        assert (arrays["index"] == index).all()
        assert np.allclose(arrays["mean"], shape / rate, rtol=1e-6)
        assert np.allclose(arrays["length"], rate - 0.25, atol=1e-5)
        assert np.allclose(arrays["probability"], 1.0 - (rate / (rate + 0.25)) ** shape, atol=1e-6)
        assert (arrays["lower"] < arrays["upper"]).all()
        assert arrays["observed"].all()


def test_what_is_refused(evidence: EvidenceMap) -> None:
    with pytest.raises(InputError, match="need the length of beams inside cells"):
        EvidenceMap(1.0, votes="beam").decay_rate()
    for name in ("shape", "rate"):
        for value in (0.0, -1.0, math.inf, math.nan):
            with pytest.raises(ConfigError, match=f"{name} is a number above 0"):
                DecayRate(evidence, **{name: value})
    for level in (0.0, 1.0, math.nan):
        with pytest.raises(ConfigError, match="level lies between"):
            DecayRate(evidence, level=level)
        with pytest.raises(ConfigError, match="level lies between"):
            evidence.decay_rate().interval(level=level)
    with pytest.raises(ConfigError, match="not a quantity"):
        evidence.decay_rate().quantity("median")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="0 m or more"):
        evidence.decay_rate().p_pass(way=-1.0)
    space = EvidenceMap(1.0, votes="beam", ndim=3, path_lengths=True)
    with pytest.raises(InputError, match="this one is 3D"):
        space.decay_rate().save_png("x.png")
