# SPDX-License-Identifier: Apache-2.0
"""The joint posterior against enumeration by hand, and what follows from Bayes' rule."""

from __future__ import annotations

import doctest
import math
from typing import Any

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.forward.beams import Beams
from oddsmap.forward.model import ForwardModel
from oddsmap.forward.occupancy_box import Window
from oddsmap.full_map import exact
from oddsmap.full_map.exact import ExactPosterior
from oddsmap.poses.pose import Pose2
from oddsmap.scans.scan import Scan

CELL = 0.1
SONAR = ForwardModel(cone_deg=25.0, range_max=1.2)


def drawn_beams(shape: tuple[int, ...], count: int, rng: np.random.Generator) -> Beams:
    """A world drawn at p = .2, seen from around it."""
    d = len(shape)
    truth = Window((rng.random(shape) < 0.2).astype(float), CELL)
    way = rng.normal(size=(count, d))
    way /= np.linalg.norm(way, axis=1)[:, None]
    middle = np.array(shape[::-1]) * CELL / 2
    return SONAR.simulate(middle - way * rng.uniform(0.2, 0.6, (count, 1)), way, truth, rng)


@pytest.mark.parametrize("shape", [(1, 2), (2, 2), (3, 1), (1, 2, 2)])
@pytest.mark.parametrize("coupling", [0.0, 0.7])
def test_every_map_by_hand(shape: tuple[int, ...], coupling: float) -> None:
    rng = np.random.default_rng(sum(shape))
    beams = drawn_beams(shape, 5, rng)
    prior = rng.uniform(0.1, 0.9, shape)
    posterior = ExactPosterior(shape, resolution=CELL, prior=prior, coupling=coupling)
    posterior.update(beams, SONAR)
    weights, priors = [], []
    for m in posterior.maps:
        p = float(np.prod(np.where(m, prior, 1 - prior)))
        for axis in range(len(shape)):
            p *= math.exp(coupling * np.count_nonzero(np.diff(m.astype(int), axis=axis) == 0))
        priors.append(p)
        weights.append(p * np.prod(SONAR.likelihood(beams, Window(m.astype(float), CELL))))
    joint = np.array(weights) / sum(weights)
    np.testing.assert_allclose(posterior.probabilities, joint, atol=1e-12)
    assert posterior.log_evidence == pytest.approx(math.log(sum(weights) / sum(priors)))
    maps = posterior.maps.astype(float)
    np.testing.assert_allclose(posterior.marginals(), np.tensordot(joint, maps, 1), atol=1e-12)
    assert np.array_equal(posterior.most_probable(), posterior.maps[np.argmax(joint)])
    marginal = posterior.marginals()
    product = [np.prod(np.where(m, marginal, 1 - marginal)) for m in posterior.maps]
    np.testing.assert_allclose(posterior.product_approximation(), product, atol=1e-12)
    divergence = np.sum(joint * np.log(joint / product))
    assert posterior.product_divergence() == pytest.approx(divergence, abs=1e-12)
    assert divergence > 1e-8


def test_maps_count_in_binary() -> None:
    maps = ExactPosterior((2, 2), resolution=CELL).maps
    assert maps.shape == (16, 2, 2)
    assert not maps[0].any()
    assert maps[1].tolist() == [[True, False], [False, False]]
    assert maps[2].tolist() == [[False, True], [False, False]]
    assert maps[4].tolist() == [[False, False], [True, False]]


def test_many_cells_against_the_likelihood_of_single_maps() -> None:
    rng = np.random.default_rng(7)
    beams = drawn_beams((4, 4), 12, rng)
    lo = np.array([3, -2])
    moved = Beams(beams.origins + lo * CELL, beams.directions, beams.ranges)
    detection = rng.uniform(0.2, 1.0, (4, 4))
    posterior = ExactPosterior((4, 4), resolution=CELL, lo=lo, prior=0.2)
    posterior.update(moved, SONAR, detection=detection)
    joint, maps = posterior.probabilities, posterior.maps
    some = rng.choice(1 << 16, 40, replace=False)

    def log_weight(number: int) -> float:
        m = maps[number].astype(float)
        window = Window(m, CELL, lo=lo, detection=detection)
        prior = float(m.sum()) * math.log(0.2) + float((1 - m).sum()) * math.log(0.8)
        return float(SONAR.log_likelihood(moved, window).sum()) + prior

    base = log_weight(0) - math.log(joint[0])
    got = [math.log(joint[i]) + base for i in some]
    assert got == pytest.approx([log_weight(int(i)) for i in some], abs=1e-6)


def test_order_and_batches_do_not_matter() -> None:
    beams = drawn_beams((3, 3), 8, np.random.default_rng(1))
    whole, single = (ExactPosterior((3, 3), resolution=CELL, prior=0.2) for _ in range(2))
    whole.update(beams, SONAR)
    for i in range(7, -1, -1):
        single.update(
            Beams(beams.origins[i : i + 1], beams.directions[i : i + 1], beams.ranges[i : i + 1]),
            SONAR,
        )
    np.testing.assert_allclose(single.probabilities, whole.probabilities, atol=1e-12)


def test_a_scan_is_its_beams_and_no_information_changes_nothing() -> None:
    prior = np.array([[0.1, 0.4], [0.7, 0.2]])
    scan = Scan(Pose2(-0.1, 0.1, 0.0), np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([0.2, np.nan]))
    one, two = (ExactPosterior((2, 2), resolution=CELL, prior=prior) for _ in range(2))
    one.update(scan, SONAR)
    two.update(Beams(np.array([[-0.1, 0.1]]), np.array([[1.0, 0.0]]), np.array([0.2])), SONAR)
    assert np.array_equal(one.probabilities, two.probabilities)
    before = two.probabilities
    two.update(Scan(scan.map_from_sensor, scan.directions, np.array([np.nan, -np.inf])), SONAR)
    # A beam that looks away from the window says something of the world, but not of its cells.
    two.update(Beams(np.array([[-0.1, 0.1]]), np.array([[-1.0, 0.0]]), np.array([0.2])), SONAR)
    np.testing.assert_allclose(two.probabilities, before, rtol=1e-12)


def test_the_filter_is_exact_where_cells_are_observed_themselves() -> None:
    """Direct observations: single-cell Bayes filter = marginals, and the joint is their product."""
    rng = np.random.default_rng(0)
    shape, seen_occupied, seen_free = (2, 3), 0.8, 0.3  # P(seen occupied | occupied or free)
    prior = rng.uniform(0.2, 0.8, shape)
    posterior = ExactPosterior(shape, resolution=CELL, prior=prior)
    odds = np.log(prior / (1 - prior))
    for _ in range(10):
        seen = rng.random(shape) < 0.5
        p = np.where(posterior.maps, seen_occupied, seen_free)
        posterior.update_likelihood(np.prod(np.where(seen, p, 1 - p), axis=(1, 2)))
        odds += np.where(
            seen,
            math.log(seen_occupied / seen_free),
            math.log((1 - seen_occupied) / (1 - seen_free)),
        )
    np.testing.assert_allclose(posterior.marginals(), 1 / (1 + np.exp(-odds)), rtol=1e-10)
    np.testing.assert_allclose(
        posterior.product_approximation(), posterior.probabilities, rtol=1e-9
    )
    assert posterior.product_divergence() < 1e-12


def test_a_wide_beam_is_not_a_product() -> None:
    """Something returned the beam: the cells alone make far too much of neither."""
    posterior = ExactPosterior((2, 1), resolution=CELL, lo=(3, 0))
    beam = Beams(np.array([[0.05, 0.1]]), np.array([[1.0, 0.0]]), np.array([0.26]))
    posterior.update(beam, ForwardModel(cone_deg=30, range_max=1.0))
    assert posterior.product_approximation()[0] > 20 * posterior.probabilities[0]


def test_the_example() -> None:
    ran = doctest.testmod(exact)
    assert ran.attempted >= 7
    assert ran.failed == 0


def test_samples_have_the_joint_distribution() -> None:
    posterior = ExactPosterior((2, 2), resolution=CELL, prior=0.3, coupling=1.0)
    posterior.update(drawn_beams((2, 2), 2, np.random.default_rng(2)), SONAR)
    drawn = posterior.sample(20_000, np.random.default_rng(0))
    assert drawn.shape == (20_000, 2, 2)
    counts = np.bincount((drawn.reshape(-1, 4) * [1, 2, 4, 8]).sum(axis=1), minlength=16)
    joint = posterior.probabilities
    np.testing.assert_array_less(
        np.abs(counts / 20_000 - joint), 5 * np.sqrt(joint / 20_000) + 1e-9
    )


def test_thousands_of_beams_do_not_underflow() -> None:
    scan = Scan(Pose2(-0.1, 0.05, 0.0), np.tile([1.0, 0.0], (3000, 1)), np.full(3000, 0.105))
    posterior = ExactPosterior((1, 2), resolution=CELL)
    posterior.update(scan, SONAR)
    assert posterior.marginals()[0, 0] == pytest.approx(1.0)
    assert posterior.probabilities.sum() == pytest.approx(1.0)
    assert math.isfinite(posterior.log_evidence)
    assert math.isfinite(posterior.product_divergence())


@pytest.mark.parametrize(
    ("shape", "others", "error", "message"),
    [
        ((3, 7), {}, MapTooLargeError, "21 cells has 2\\^21 maps"),
        ((2, 2), {"prior": 1.0}, ConfigError, "prior is a probability between 0 and 1"),
        ((2, 2), {"prior": np.full((1, 2), 0.5)}, ConfigError, "of shape \\(2, 2\\)"),
        ((2, 2), {"coupling": math.nan}, ConfigError, "coupling is a finite number"),
        ((0, 2), {}, InputError, "shape \\(ny, nx\\)"),
        ((4,), {}, InputError, "shape \\(ny, nx\\)"),
    ],
)
def test_a_bad_window(
    shape: tuple[int, ...], others: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        ExactPosterior(shape, resolution=CELL, **others)


def test_bad_updates_are_refused_and_change_nothing() -> None:
    posterior = ExactPosterior((1, 2), resolution=CELL, prior=0.3)
    before = posterior.probabilities
    beam = Beams(np.array([[0.0, 0.0]]), np.array([[1.0, 0.0]]), np.array([0.5]))
    with pytest.raises(InputError, match="4 maps is as many numbers"):
        posterior.update_likelihood(np.ones(3))
    with pytest.raises(InputError, match="4 maps is as many numbers"):
        posterior.update_likelihood(np.array([1.0, -1.0, 1.0, 1.0]))
    with pytest.raises(InputError, match="rule out every map"):
        posterior.update_likelihood(np.zeros(4))
    with pytest.raises(InputError, match="detection lies in"):
        posterior.update(beam, SONAR, detection=2.0)
    with pytest.raises(InputError, match="not finite"):
        posterior.update(Scan(Pose2(math.nan, 0, 0), np.eye(2), np.ones(2)), SONAR)
    with pytest.raises(InputError, match="3D beams"):
        posterior.update(Beams(np.zeros((1, 3)), np.eye(3)[:1], np.ones(1)), SONAR)
    assert np.array_equal(posterior.probabilities, before)
