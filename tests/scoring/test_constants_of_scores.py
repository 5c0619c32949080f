# SPDX-License-Identifier: Apache-2.0
"""What scores and calibration take for granted, as their docstrings have it: the numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from oddsmap import (
    ConeSensor,
    EvidenceMap,
    ForwardModel,
    FullMapConfig,
    Pose2,
    Scan,
    calibrate,
    evaluate,
    score_map,
)
from oddsmap.scoring import fit as fit_module
from oddsmap.scoring.leave_one_out import LeaveOneOut
from oddsmap.scoring.search import climb
from tests.kit import ONE

CONE = ConeSensor(cone_deg=10.0, range_max=3.0, p_dropout=0.0, detection=1.0)


def beam(z: float) -> Scan:
    return Scan(Pose2(0.05, 0.05, 0.0), np.array([[1.0, 0.0]]), np.array([z]))


def wall() -> EvidenceMap:
    """Surely occupied 1 m ahead."""
    evidence = EvidenceMap(0.1, sensor=CONE)
    places = np.array([[10, y] for y in range(-6, 7)])
    evidence.add_cells(places, np.full(13, 1000 * ONE), np.zeros(13, np.int64))
    return evidence


def test_what_cannot_be_costs_as_much_as_1e_12() -> None:
    scores = score_map(wall().log_odds(), [beam(math.inf)], CONE)
    assert scores.log_likelihood == pytest.approx(math.log(1e-12), rel=1e-12)


def test_constant_maps_are_16_from_1e_4_to_one_half() -> None:
    view = wall().log_odds()
    # The emptiest explains no-returns best, and the fullest what ends at once.
    assert score_map(view, [beam(math.inf)], CONE).constant == pytest.approx(1e-4)
    assert score_map(view, [beam(0.06)], CONE).constant == pytest.approx(0.5)
    found = {score_map(view, [beam(0.05 * k)], CONE).constant for k in range(2, 59)}
    steps = np.geomspace(1e-4, 0.5, 16)
    nearest = {int(np.argmin(np.abs(np.log(steps / p)))) for p in found}
    assert all(np.isclose(steps, p, rtol=1e-12).any() for p in found)
    assert len(nearest) == len(found) > 3


def test_probabilities_are_clipped_to_1e_9() -> None:
    assert evaluate([0.0], [True]).log_loss == pytest.approx(-math.log(1e-9), rel=1e-12)
    assert evaluate([1.0], [False]).log_loss == pytest.approx(-math.log(1e-9), rel=1e-12)
    assert evaluate([2e-9], [True]).log_loss == pytest.approx(-math.log(2e-9), rel=1e-12)


def test_a_climb_ends_after_twelve_steps() -> None:
    """Each is as long as the ones before together, up a slope without an end."""
    asked: list[float] = []

    def slope(x: float) -> float:
        asked.append(x)
        return x

    climb(slope, 0.0, 1.0, -math.inf, 1e30)
    # 1, 3, 7, 15...
    assert max(asked) == 2.0**12 - 1.0


# ---- calibration ------------------------------------------------------------------------------


class Slow:
    """A log that nothing can be learned from, and what is asked of it, noted."""

    def __init__(self, p_random: float, shrinking: float = 1.0, squares: float = 1e-4) -> None:
        self.no_returns = np.array([True, False])
        self.settled: list[int] = []
        self.went_on: list[int] = []
        self.p_random, self.shrinking, self.squares = p_random, shrinking, squares

    def settle(self, model: ForwardModel, edge: float, sweeps: int) -> None:
        self.settled.append(sweeps)

    def go_on(self, model: ForwardModel, sweeps: int) -> None:
        self.went_on.append(sweeps)

    def causes(self, model: ForwardModel) -> np.ndarray[Any, Any]:
        from oddsmap.kernels.infer.responsibilities import DROPOUT, LIKELIHOOD, RANDOM, SQUARES

        found = np.zeros((2, 4))
        found[:, RANDOM] = self.p_random
        found[:, DROPOUT] = 0.02
        found[:, LIKELIHOOD] = 0.5
        found[:, SQUARES] = self.squares * (1.0 - self.p_random)
        self.p_random *= self.shrinking
        return found

    def log_likelihood(self, model: ForwardModel) -> float:
        return 0.0


MODEL = ForwardModel(
    cone_deg=10.0, range_max=3.0, p_random=0.02, p_dropout=0.02, sigma=math.sqrt(2e-4)
)


def renewed(work: Slow, model: ForwardModel = MODEL) -> fit_module.Fit:
    fit = fit_module.Fit(work, model, 2, 20, None)
    fit.settle()
    fit.renew_noise()
    return fit


def test_a_map_settles_in_six_sweeps_and_goes_on_with_three() -> None:
    work = Slow(0.02)
    renewed(work)
    assert set(work.settled) == {6}
    assert set(work.went_on) == {3}


@pytest.mark.parametrize(("step", "rests"), [(4.9e-4, True), (5.1e-4, False)])
def test_rates_rest_within_5e_4(step: float, rests: bool) -> None:
    fit = renewed(Slow(0.02 + step))
    # From 0.02 to there in the first update; in the second it does not move.
    assert (fit.updates == 1) == rests
    assert fit.converged


@pytest.mark.parametrize(("share", "rests"), [(4.9e-3, True), (5.1e-3, False)])
def test_noise_rests_within_half_a_percent(share: float, rests: bool) -> None:
    # Half of the beams are no-returns, whose squares count and whose weight does not.
    sigma = math.sqrt(2e-4) * (1.0 + share)
    fit = renewed(Slow(0.02, squares=sigma**2 / 2.0))
    assert fit.model.sigma == pytest.approx(sigma, rel=1e-12)
    assert (fit.updates == 1) == rests


def test_rates_stay_above_1e_4() -> None:
    fit = renewed(Slow(0.0))
    assert fit.model.p_random == 1e-4
    assert math.isnan(fit.noise_errors()["p_random"])
    above = renewed(Slow(1.1e-4))
    assert above.model.p_random == pytest.approx(1.1e-4)


def test_the_edge_is_searched_up_to_sixteen_times_as_steep() -> None:
    class Steeper(Slow):
        edge = 1.0

        def settle(self, model: ForwardModel, edge: float, sweeps: int) -> None:
            self.edge = edge

        def log_likelihood(self, model: ForwardModel) -> float:
            return self.edge

    fit = fit_module.Fit(Steeper(0.02), MODEL, 2, 20, None)
    fit.search_edge(1.0, 1.0)
    assert fit.edge == 16.0


@pytest.mark.parametrize(
    ("factor", "listed"), [(1.0, False), (1.09, False), (1.11, True), (0.61, False), (0.59, True)]
)
def test_cells_are_listed_anew_where_noise_is_a_tenth_larger_or_much_smaller(
    factor: float, listed: bool
) -> None:
    from oddsmap import Beams

    beams, _ = Beams.from_scans([beam(1.0)])
    work = LeaveOneOut(beams, 0.1, FullMapConfig())
    model = ForwardModel(cone_deg=10.0, range_max=3.0, sigma=0.1)
    work.settle(model, 1.0, 1)
    before = work._all_rows
    wider = ForwardModel(cone_deg=10.0, range_max=3.0, sigma=0.1 * factor)
    work.go_on(wider, 1)
    assert (work._all_rows is not before) == listed


def test_bins_of_a_calibration_are_an_eighth_of_a_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    """The least noise that can be found is half of one."""
    widths: list[float | None] = []
    settle = fit_module.Fit.settle

    def noted(self: fit_module.Fit) -> None:
        widths.append(self.model.bin_width)
        settle(self)

    monkeypatch.setattr(fit_module.Fit, "settle", noted)
    scans = [beam(1.0 + 0.01 * k) for k in range(5)]
    calibrate(scans, 0.1, sensor=ConeSensor(cone_deg=10.0, range_max=3.0), noise_only=True)
    assert widths == [0.1 / 8]
