# SPDX-License-Identifier: Apache-2.0
"""The view whose probabilities are fitted to the map's counts."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap import ConfigError, EvidenceMap, evaluate, load_map
from oddsmap.odds import logit, sigmoid
from oddsmap.simulate import Lidar2D, office_drive, office_plan
from tests.kit import ONE, add_votes


@cache
def office(noise: float = 0.0, count: int = 80) -> EvidenceMap:
    """A drive through the office, with poses that are off by some metres."""
    rng, plan, lidar = np.random.default_rng(7), office_plan(), Lidar2D()
    scans = []
    for pose in office_drive(320)[:: 320 // count]:
        scan = lidar.scan(plan, pose, rng)
        x, y = rng.normal(0.0, noise, 2) if noise else (0.0, 0.0)
        moved = oddsmap.Pose2(pose.x + x, pose.y + y, pose.theta)
        scans.append(oddsmap.Scan(moved, scan.directions, scan.ranges))
    return oddsmap.build_map(scans, 0.05)


def truth_of(grid: EvidenceMap) -> np.ndarray:
    (x0, y0), (x1, y1) = grid.bounds() or ((0, 0), (1, 1))
    cells = office_plan().rasterise(0.05, (int(x0), int(y0)), (int(x1), int(y1)), samples=5)
    return np.asarray(cells)


@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_occupancy_is_truer_than_log_odds(noise: float) -> None:
    grid = office(noise)
    truth, known = truth_of(grid), grid.log_odds().observed()
    ours = evaluate(grid.calibrated().probability(), truth, known)
    textbook = evaluate(grid.log_odds().probability(), truth, known)
    assert ours.log_loss < 0.8 * textbook.log_loss
    assert ours.ece < 0.5 * textbook.ece


def test_held_out_beams_are_predicted_better_than_by_log_odds() -> None:
    grid, other = office(0.01), office(0.011)
    lo, hi = grid.bounds() or ((0, 0), (1, 1))
    hits, passes = other.region(lo, hi)
    known = grid.log_odds().observed()

    def log_loss(p: np.ndarray) -> float:
        p = np.clip(p, 1e-9, 1.0 - 1e-9)
        loss = -(hits * np.log(p) + passes * np.log1p(-p))[known].sum()
        return float(loss / (hits + passes)[known].sum())

    ours = log_loss(grid.calibrated().reflectivity.mean())
    assert ours < 0.6 * log_loss(grid.log_odds().probability())


def test_the_prior_and_the_clamp_are_those_of_any_view() -> None:
    grid = office()
    view = grid.calibrated()
    assert view.prior == view.model.occupied_share
    other = grid.calibrated(prior=0.5)
    index, ours = view.known_log_odds()
    shifted = ours - float(logit(view.prior))
    assert np.allclose(other.log_odds_at(index), shifted, atol=1e-9)
    far = [[9999, 9999]]
    assert grid.calibrated(prior=0.3).log_odds_at(far)[0] == float(logit(0.3))
    plan = oddsmap.PriorArray(np.full((4, 4), 0.8), tuple(index[0]))
    with_map = grid.calibrated(prior=plan)
    assert with_map.log_odds_at(index[:1])[0] == pytest.approx(float(logit(0.8)) + shifted[0])
    p = grid.calibrated(clamp=(0.1, 0.9)).probability()
    assert p.min() == pytest.approx(0.1)
    assert p.max() == pytest.approx(0.9)
    with pytest.raises(ConfigError, match="prior is a probability"):
        grid.calibrated(prior=0.0)


def test_certainty_saturates_where_beams_disagree() -> None:
    view = office().calibrated(prior=0.5)
    few, many = (float(view.of_votes(0.4 * n, 0.6 * n)) for n in (100.0, 100_000.0))
    assert abs(many - few) < 1.0  # log odds would differ by thousands of nats
    assert few > 1.0  # a wall that two beams of five see is a wall


def test_merged_saved_and_loaded_maps_have_the_same_bits(tmp_path: Path) -> None:
    grid = office(0.01)
    grid.save(tmp_path / "a.zarr")
    again = load_map(tmp_path / "a.zarr")
    empty = EvidenceMap(0.05)
    for other in (again, empty + grid):
        view = other.calibrated()
        assert view.model == grid.calibrated().model
        assert np.array_equal(view.probability(), grid.calibrated().probability())
    first = grid.calibrated().model
    assert grid.crop((0, 0), (50, 50)).calibrated(model=first).model == first


def test_what_is_written(tmp_path: Path) -> None:
    view = office().calibrated()
    view.save_npz(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        hits, passes = arrays["hits"], arrays["passes"]
        p = sigmoid(view.of_votes(hits, passes))
        assert np.allclose(arrays["probability"], p, atol=1e-6)
        a, b = view.reflectivity.a, view.reflectivity.b
        mean = (a + hits) / (a + b + hits + passes)
        assert np.allclose(arrays["reflectivity"], mean, atol=1e-6)
        assert (arrays["reflectivity_low"] <= arrays["reflectivity"] + 1e-6).all()
        assert (arrays["reflectivity"] <= arrays["reflectivity_high"] + 1e-6).all()


def test_wide_beams_are_warned_of() -> None:
    grid = EvidenceMap(0.1, sensor=oddsmap.ConeSensor(cone_deg=20.0, range_max=4.0))
    add_votes(grid, {(0, 0): (ONE, 0)})
    with pytest.warns(UserWarning, match="build_full_map"):
        grid.calibrated()


def test_an_empty_map_has_its_prior() -> None:
    view = EvidenceMap(0.1).calibrated()
    assert view.bounds() is None
    assert math.isclose(float(view.at([[0.0, 0.0]])[0]), view.prior)
