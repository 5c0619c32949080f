# SPDX-License-Identifier: Apache-2.0
"""Reflection maps from beam factors: what they are made of, and the view of them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats

from oddsmap import BeamSensor, ConeSensor, GridScan, OverheadSensor, State, build_reflection_map
from oddsmap.errors import ConfigError, InputError
from oddsmap.forward.beams import Beams
from oddsmap.forward.model import ForwardModel
from oddsmap.full_map.reflection_map import ReflectionMap
from oddsmap.kernels.infer.beam_factor import BeamRows
from oddsmap.kernels.infer.beta_factor import filter_beams
from oddsmap.poses.pose import Pose2
from oddsmap.posterior.beta import beta_interval
from oddsmap.posterior.reflectivity import Quantity
from oddsmap.scans.scan import Scan
from tests.full_map.kit import SONAR, TOF, beam, moved, room, wall_of_space

BOX = ((-10, -10), (70, 50))


def estimated(scans: list[Scan], **options: Any) -> ReflectionMap:
    sensor = SONAR if isinstance(scans[0].map_from_sensor, Pose2) else TOF
    return build_reflection_map(scans, 0.1, sensor=sensor, **options)


def test_few_beams_say_something() -> None:
    """The mean of the prior: at 1/2 no beam is believed to come far."""
    view, half = estimated(room(20)), estimated(room(20), a=0.1, b=0.1)
    free = np.zeros((60, 80), np.bool_)
    free[11:35, 11:69] = True  # before the box, off the walls
    assert np.mean(view.mean(BOX)[free] < 0.1) > 0.8
    assert np.mean(half.mean(BOX)[free] < 0.1) < 0.1


def test_one_pass_in_the_order_of_the_log() -> None:
    """The array-level filter on a window, with the model that is said."""
    scans = room(20)
    view = estimated(scans, method="adf", a=0.3, b=0.2)
    model = ForwardModel(
        cone_deg=25.0, range_max=3.0, detection=1.0, sigma=0.035, range_bias=0.2 / math.pi
    )
    beams, _ = Beams.from_scans(scans)
    a, b = np.full(80 * 60, 0.3), np.full(80 * 60, 0.2)
    for part, listed in model.cells(beams, 0.1, BOX[0], (60, 80)):
        rows = BeamRows(
            beams.ranges[part], listed.offsets, listed.cells.astype(np.int32),
            listed.bins.astype(np.uint16), listed.fractions,
        )  # fmt: skip
        filter_beams(rows, np.arange(len(rows.readings)), model.noise(0.1), np.ones(1), a, b)
    alpha, beta = view.parameters(BOX)
    np.testing.assert_array_equal(alpha.ravel(), a)
    np.testing.assert_array_equal(beta.ravel(), b)
    assert view.report.beams == 240
    assert view.provenance[0]["estimator"] == "reflection"


def test_quantities_are_of_the_beta_distributions() -> None:
    view = estimated(room(20))
    index, alpha, beta = view.cells()
    assert len(index) == np.count_nonzero(view.observed(BOX))
    at = tuple((index - np.array(BOX[0])).T[::-1])
    known = scipy.stats.beta(alpha, beta)
    np.testing.assert_allclose(view.mean(BOX)[at], known.mean())
    np.testing.assert_allclose(view.std(BOX)[at], known.std(), rtol=1e-9)
    np.testing.assert_allclose(view.p_above(BOX, threshold=0.3)[at], known.sf(0.3), rtol=1e-6)
    lower, upper = view.interval(BOX)
    shortest = beta_interval(alpha, beta, 0.95, "highest-density")
    np.testing.assert_array_equal((lower[at], upper[at]), shortest)
    narrow = np.ptp(view.interval(BOX), axis=0) - np.ptp(
        view.interval(BOX, kind="equal-tailed"), axis=0
    )
    assert narrow[at].max() < 1e-9
    assert narrow[at].min() < -0.001
    # Nothing known: the prior's.
    assert view.mean(((500, 500), (501, 501))).item() == 0.25
    assert view.state(((500, 500), (501, 501))).item() == State.UNKNOWN
    bounds = view.bounds()
    assert bounds is not None
    np.testing.assert_array_equal(bounds, [index.min(axis=0), index.max(axis=0) + 1])
    states = view.state(BOX)[at]
    assert np.mean(states == State.FREE) > 0.5
    assert np.count_nonzero(states == State.OCCUPIED) > 5


def test_behind_a_wall_is_unknown() -> None:
    near = [beam(0.05, 0.05, 0.0, 1.0)] * 30
    view = estimated([*near, beam(0.05, 0.05, 0.0, 2.5)])
    assert view.observed(((5, 0), (6, 1))).item()
    assert not view.observed(((20, 0), (21, 1))).item()
    alpha, beta = view.parameters(((20, 0), (21, 1)))
    assert alpha + beta == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("method", ["ep", "em"])
def test_it_goes_on_until_means_rest(method: Any) -> None:
    seen: list[tuple[int, float]] = []
    view = estimated(room(20), method=method, sweeps=300, progress=lambda *x: seen.append(x))
    assert [number for number, _ in seen] == list(range(1, view.sweeps + 1))
    assert seen[-1][1] == view.residual < 1e-4 <= seen[-2][1]
    assert view.converged
    once = estimated(room(20), method=method, sweeps=1)
    assert not once.converged
    assert (once.sweeps, once.residual) == seen[0]
    assert np.abs(view.mean(BOX) - once.mean(BOX)).max() > 0.01


def test_em_counts_informative_trials() -> None:
    """Thirty readings of one ray: twenty from the cell, ten from behind it."""
    near, far = beam(0.05, 0.05, 0.0, 0.9), beam(0.05, 0.05, 0.0, 2.0)
    sensor = BeamSensor(range_max=3.0, sigma=0.02, p_random=1e-6, p_dropout=1e-6)
    view = build_reflection_map(
        [near] * 20 + [far] * 10, 0.1, sensor=sensor, method="em", range_bias=0.05
    )
    alpha, beta = (x.item() for x in view.parameters(((9, 0), (10, 1))))
    assert alpha == pytest.approx(20.05, abs=0.3)
    assert beta == pytest.approx(10.15, abs=0.3)


def test_order_and_place() -> None:
    scans = room(20)
    view = estimated(scans)
    np.testing.assert_array_equal(estimated(scans).parameters(BOX), view.parameters(BOX))
    turned = estimated(scans[::-1])
    assert np.abs(turned.mean(BOX) - view.mean(BOX)).mean() < 1e-3
    away = estimated(moved(scans, (6.4, -3.2)))  # whole blocks: the same beams in the same order
    there = [np.array(end) + np.array([64, -32]) for end in BOX]
    np.testing.assert_allclose(away.mean((there[0], there[1])), view.mean(BOX), atol=1e-6)


def test_space() -> None:
    view = estimated(wall_of_space(1.5, 12))
    assert view.ndim == 3
    index, alpha, beta = view.cells()
    mean = alpha / (alpha + beta)
    assert mean[index[:, 0] < 12].mean() < 0.05
    wall = (index[:, 0] == 14) | (index[:, 0] == 15)
    assert mean[wall].mean() > 0.25
    assert mean[wall].max() > 0.8
    with pytest.raises(InputError, match=r"write its reflectivity as \.npz"):
        view.to_probability_map()


def test_export(tmp_path: Path) -> None:
    view = estimated(room(20))
    view.save_npz(tmp_path / "m.npz")
    index, alpha, beta = view.cells()
    with np.load(tmp_path / "m.npz") as arrays:
        np.testing.assert_array_equal(arrays["index"], index)
        np.testing.assert_array_equal(arrays["hits"], np.maximum(alpha - view.a, 0.0))
        np.testing.assert_array_equal(arrays["passes"], np.maximum(beta - view.b, 0.0))
        np.testing.assert_allclose(arrays["probability"], alpha / (alpha + beta), rtol=1e-6)
        assert (arrays["lower"] <= arrays["upper"]).all()
        assert arrays["observed"].all()
    shows: tuple[Quantity, ...] = ("mean", "interval-width")
    for show in shows:
        view.save_png(tmp_path / f"{show}.png", show=show)
        assert (tmp_path / f"{show}.png").stat().st_size > 1000
    assert len(view.save_ros(tmp_path / "m.yaml")) == 2


def test_what_the_log_says_of_its_sensor() -> None:
    """A plain list of scans says nothing: rays without range_max, which no forward model is of."""
    with pytest.raises(ConfigError, match="range_max"):
        build_reflection_map(room(2), 0.1)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"a": 0.0}, "prior's a is a weight above 0, got 0"),
        ({"b": math.nan}, "prior's b is a weight"),
        ({"method": "mean"}, "method is ep or adf or em, got 'mean'"),
        ({"sweeps": 0}, "sweeps: at least 1"),
        ({"range_bias": 5.0}, "range_bias is below range_max"),
    ],
)
def test_bad_values(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        estimated(room(2), **options)


def test_bad_scans() -> None:
    with pytest.raises(InputError, match="no usable scan"):
        build_reflection_map([], 0.1, sensor=SONAR)
    cells = GridScan(Pose2(0.0, 0.0, 0.0), np.zeros((2, 2)), 0.1, (0.0, 0.0))
    with pytest.raises(ConfigError, match="sees cells one by one"):
        build_reflection_map([cells], 0.1, sensor=OverheadSensor())
    with pytest.raises(ConfigError, match="p_random lies above 0"):
        build_reflection_map(
            room(2), 0.1, sensor=ConeSensor(cone_deg=25.0, range_max=3.0, p_random=0.0)
        )
