# SPDX-License-Identifier: Apache-2.0
"""Reflectivities from beams: moments by integration, counts by every outcome of a small cone."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.forward.model import ForwardModel
from oddsmap.kernels.infer.beam_factor import BeamRows
from oddsmap.kernels.infer.beta_factor import (
    VOTE,
    beta_update,
    expected_counts,
    filter_beams,
    revisit_beams,
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
from tests.naive.forward import bin_likelihood

CELLS = 4
MODEL = ForwardModel(cone_deg=20.0, range_max=1.5)
NOISE = MODEL.noise(RESOLUTION)

weights = st.floats(0.1, 200.0)
likelihoods = st.floats(1e-6, 1.0)


@given(weights, weights, likelihoods, likelihoods)
def test_moments_of_the_mixture(a: float, b: float, mu0: float, mu1: float) -> None:
    """Mean and variance from the two Beta distributions that the posterior is made of."""
    w = mu1 * a / (mu1 * a + mu0 * b)
    parts = [scipy.stats.beta(a + 1, b), scipy.stats.beta(a, b + 1)]
    mean = w * parts[0].mean() + (1 - w) * parts[1].mean()
    square = sum(c * (p.var() + p.mean() ** 2) for c, p in zip((w, 1 - w), parts, strict=True))
    got = scipy.stats.beta(*beta_update(a, b, mu0, mu1))
    assert got.mean() == pytest.approx(mean, rel=1e-9)
    assert got.var() == pytest.approx(square - mean * mean, rel=1e-6)


@pytest.mark.parametrize(
    ("a", "b", "mu0", "mu1"), [(1, 1, 0.2, 0.7), (5, 2, 0.9, 0.1), (2, 30, 0.01, 0.5)]
)
def test_moments_by_integration(a: float, b: float, mu0: float, mu1: float) -> None:
    """Bayes' rule on a grid of reflectivities."""
    rho = (np.arange(200_000) + 0.5) / 200_000
    density = scipy.stats.beta(a, b).pdf(rho) * (mu0 * (1 - rho) + mu1 * rho)
    density /= density.sum()
    mean = float((density * rho).sum())
    got = scipy.stats.beta(*beta_update(float(a), float(b), mu0, mu1))
    assert got.mean() == pytest.approx(mean, abs=1e-7)
    assert got.var() == pytest.approx(float((density * (rho - mean) ** 2).sum()), abs=1e-7)


def test_certain_and_empty_readings() -> None:
    assert beta_update(2.0, 3.0, 0.0, 0.5) == pytest.approx((3.0, 3.0))
    assert beta_update(2.0, 3.0, 0.5, 0.0) == pytest.approx((2.0, 4.0))
    assert beta_update(2.0, 3.0, 0.4, 0.4) == pytest.approx((2.0, 3.0))
    assert beta_update(2.0, 3.0, 0.0, 0.0) == (2.0, 3.0)
    a, b = 3.0, 4000.0
    for _ in range(10_000):
        a, b = beta_update(a, b, 0.4, 0.4)
    assert (a, b) == pytest.approx((3.0, 4000.0), rel=1e-9)


@given(
    st.lists(beams(CELLS, most=CELLS), min_size=1, max_size=4), models, detections(CELLS),
    st.lists(st.floats(0.3, 9.0), min_size=2 * CELLS, max_size=2 * CELLS),
)  # fmt: skip
def test_beams_in_turn(
    some: list[Beam], model: ForwardModel, detection: FloatArray, prior: list[float]
) -> None:
    """Cells of a beam together, from what the beams before it left; likelihoods over all maps."""
    a, b = np.array(prior).reshape(2, CELLS)
    slow = [(float(x), float(y)) for x, y in zip(a, b, strict=True)]
    order = np.arange(len(some))[::-1].copy()
    for n in order:
        cells = [cell for cell, _, _ in some[n].cells]
        q = tuple(slow[c][0] / sum(slow[c]) for c in cells)
        for i, cell in enumerate(cells):
            mu0, mu1 = (mu(model, some[n], q, i, m, detection) for m in (0, 1))
            slow[cell] = beta_update(slow[cell][0], slow[cell][1], mu0, mu1)
    filter_beams(rows_of(some), order, model.noise(RESOLUTION), detection, a, b)
    np.testing.assert_allclose(np.stack([a, b], axis=1), slow, rtol=1e-6)


@given(
    st.lists(beams(CELLS, most=CELLS), min_size=1, max_size=4), models, detections(CELLS),
    st.lists(st.floats(0.3, 9.0), min_size=2 * CELLS, max_size=2 * CELLS),
)  # fmt: skip
def test_beams_again(
    some: list[Beam], model: ForwardModel, detection: FloatArray, prior: list[float]
) -> None:
    """Three sweeps of expectation propagation, two of them damped; likelihoods over all maps."""
    a, b = np.array(prior).reshape(2, CELLS)
    slow = np.stack([a, b], axis=1)
    said = [np.zeros((len(beam.cells), 2)) for beam in some]
    left = 0
    for keep in (0.0, 0.5, 0.3):
        for beam, last in zip(some, said, strict=True):
            cells = [cell for cell, _, _ in beam.cells]
            without = slow[cells] - last
            proper = without.min(axis=1) >= 1e-3
            asked = np.where(proper[:, None], without, slow[cells])
            q = tuple((asked[:, 0] / asked.sum(axis=1)).tolist())
            for i, cell in enumerate(cells):
                mu0, mu1 = (mu(model, beam, q, i, m, detection) for m in (0, 1))
                new = np.array(beta_update(without[i, 0], without[i, 1], mu0, mu1))
                said_now = keep * last[i] + (1 - keep) * (new - without[i])
                if proper[i] and (without[i] + said_now).min() >= 1e-3:
                    slow[cell], last[i] = without[i] + said_now, said_now
                else:
                    left += 1
    rows = rows_of(some)
    told = np.zeros((len(rows.cells), 2), np.float32)
    order = np.arange(len(some))
    arguments = (rows, order, model.noise(RESOLUTION), detection, a, b, told)
    assert sum(revisit_beams(*arguments, keep) for keep in (0.0, 0.5, 0.3)) == left
    np.testing.assert_allclose(np.stack([a, b], axis=1), slow, rtol=1e-4)


def test_the_first_time_is_the_filter() -> None:
    some, _, detection = scene()
    rows, order = rows_of(some), np.arange(len(some))
    one, other = np.full((2, 3), 0.5), np.full((2, 3), 0.5)
    filter_beams(rows, order, NOISE, detection, one[0], one[1])
    told = np.zeros((len(rows.cells), 2), np.float32)
    assert revisit_beams(rows, order, NOISE, detection, other[0], other[1], told, 0.0) == 0
    np.testing.assert_allclose(one, other, rtol=1e-5)
    # What beams said adds up to what is known now.
    added = [np.bincount(rows.cells, told[:, k]) for k in (0, 1)]
    np.testing.assert_allclose(other - 0.5, added, rtol=1e-5)


def test_order_does_not_matter_where_it_rests() -> None:
    some, truth, detection = scene()
    rows, ends = rows_of(some), []
    for seed in (0, 1):
        order = np.random.default_rng(seed).permutation(len(some))
        ab, told = np.full((2, 3), 0.5), np.zeros((len(rows.cells), 2), np.float32)
        for _ in range(40):
            revisit_beams(rows, order, NOISE, detection, ab[0], ab[1], told, 0.5)
        ends.append(ab)
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-4)
    once = np.full((2, 3), 0.5)
    order = np.random.default_rng(0).permutation(len(some))
    filter_beams(rows, order, NOISE, detection, once[0], once[1])
    assert np.abs(once / ends[0] - 1.0).max() > 1e-3
    np.testing.assert_allclose(ends[0][0] / ends[0].sum(axis=0), truth, atol=0.1)


def outcomes(
    model: ForwardModel, beam: Beam, rho: FloatArray, detection: FloatArray
) -> tuple[float, dict[int, FloatArray]]:
    """Z, and for each cell P(reached, returns or not, detected or not | z), shape (2, 2)."""
    width = model.bin_width_at(RESOLUTION)
    total = 0.0
    of_cell = {cell: np.zeros((2, 2)) for cell, _, _ in beam.cells}
    for drawn in product(product((0, 1), (0, 1)), repeat=len(beam.cells)):
        weight, first = 1.0, None
        for (cell, k, fraction), (m, e) in zip(beam.cells, drawn, strict=True):
            d = float(detection[cell]) * float(np.float32(fraction))
            weight *= (rho[cell] if m else 1 - rho[cell]) * (d if e else 1 - d)
            if m and e and first is None:
                first = k
        weight *= bin_likelihood(model, beam.reading, first, width)
        total += weight
        for (cell, k, _), (m, e) in zip(beam.cells, drawn, strict=True):
            if first is None or k <= first:
                of_cell[cell][m, e] += weight
    return total, {cell: table / total for cell, table in of_cell.items()}


chances = st.lists(
    st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0.0, 1.0)), min_size=CELLS, max_size=CELLS
)


@given(beams(CELLS, most=CELLS), models, detections(CELLS), chances.map(np.array))
def test_expected_counts_over_every_outcome(
    beam: Beam, model: ForwardModel, detection: FloatArray, rho: FloatArray
) -> None:
    z, table = outcomes(model, beam, rho, detection)
    # The kernel holds no cell to return a beam more surely than by 1 - 1e-12, and Z may be small.
    close = 1e-8 + CELLS * 1e-12 / z
    for informative in (False, True):
        hits, passes = np.zeros(CELLS, np.int64), np.zeros(CELLS, np.int64)
        log_z = expected_counts(
            rows_of([beam]), model.noise(RESOLUTION), detection, rho, informative, hits, passes
        )
        assert log_z == pytest.approx(math.log(z), abs=close)
        for cell in range(CELLS):
            part = table.get(cell, np.zeros((2, 2)))
            part = part[:, 1:] if informative else part
            assert hits[cell] / VOTE == pytest.approx(part[1].sum(), abs=close)
            assert passes[cell] / VOTE == pytest.approx(part[0].sum(), abs=close)


def scene() -> tuple[list[Beam], FloatArray, FloatArray]:
    """Readings drawn for three cells of reflectivity 0.2, 0.5 and 0.9, two of them side by side."""
    rng = np.random.default_rng(4)
    truth, detection = np.array([0.2, 0.5, 0.9]), np.array([0.9, 1.0, 0.7])
    # The middle of bins 8, 20 and 20; each half or wholly in the cone.
    drawn = []
    for _ in range(600):
        fractions = rng.choice([0.25, 1.0], 3)
        returned = rng.random(3) < truth * detection * fractions
        if returned[0]:
            reading = 0.2125 + 0.035 * rng.standard_normal()
        elif returned[1:].any():
            reading = 0.5125 + 0.035 * rng.standard_normal()
        else:
            reading = math.inf
        cells = tuple(zip((0, 1, 2), (8, 20, 20), fractions.tolist(), strict=True))
        drawn.append(Beam(reading, cells))
    return drawn, truth, detection


def expect(
    rows: BeamRows, detection: FloatArray, rho: FloatArray, informative: bool
) -> tuple[FloatArray, FloatArray, float]:
    hits, passes = np.zeros(len(rho), np.int64), np.zeros(len(rho), np.int64)
    total = expected_counts(rows, NOISE, detection, rho, informative, hits, passes)
    return hits / VOTE, passes / VOTE, total


def test_both_counts_lead_to_the_same_most_likely_map() -> None:
    some, truth, detection = scene()
    rows = rows_of(some)
    ends = []
    for informative in (False, True):
        rho, last = np.full(3, 0.5), -math.inf
        for _ in range(1500):
            hits, passes, total = expect(rows, detection, rho, informative)
            assert total >= last - 1e-9  # EM climbs
            rho, last = hits / (hits + passes), total
        ends.append(rho)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-4)
    np.testing.assert_allclose(ends[0], truth, atol=0.12)
    for i in range(3):  # no step leads up from there
        for step in (-0.01, 0.01):
            moved = ends[0].copy()
            moved[i] += step
            assert expect(rows, detection, moved, True)[2] < last
    # Fewer trials tell something than beams came by.
    all_hits, all_passes, _ = expect(rows, detection, ends[0], False)
    hits, passes, _ = expect(rows, detection, ends[0], True)
    assert ((hits + passes) < 0.9 * (all_hits + all_passes)).all()


def test_counts_add_up_in_any_order() -> None:
    some, _, detection = scene()
    rho = np.array([0.3, 0.4, 0.8])
    one = expect(rows_of(some), detection, rho, True)
    other = expect(rows_of(some[::-1]), detection, rho, True)
    np.testing.assert_array_equal(one[0], other[0])
    np.testing.assert_array_equal(one[1], other[1])


def test_a_hit_is_shared_by_who_may_have_caused_it() -> None:
    """An arc of four cells, one of which is known to return beams and one to let them pass."""
    cone = Beam(0.5125, tuple((i, 20, 1.0) for i in range(4)))
    a, b = np.array([1.0, 1.0, 40.0, 1.0]), np.array([1.0, 1.0, 1.0, 40.0])
    before = a / (a + b)
    filter_beams(rows_of([cone]), np.arange(1), NOISE, np.ones(1), a, b)
    gain = a / (a + b) - before
    # The known reflector explains the echo, so nobody gains much; with it gone the others do.
    assert 0.0 <= gain[0] < 0.01
    # Two at 1/2 share it: each returned it with probability 2/3.
    a, b = np.array([1.0, 1.0, 1.0, 1.0]), np.array([1.0, 1.0, 400.0, 400.0])
    filter_beams(rows_of([cone]), np.arange(1), NOISE, np.ones(1), a, b)
    assert a[0] / (a[0] + b[0]) == pytest.approx(5 / 9, abs=0.01)
    assert a[2] / (a[2] + b[2]) < 0.01
