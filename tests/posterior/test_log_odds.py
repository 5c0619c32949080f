# SPDX-License-Identifier: Apache-2.0
"""The view against the recursion of the textbook (Probabilistic Robotics, table 9.1)."""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import BeamSensor, EvidenceMap, LogOdds, State, Thresholds, build_map
from oddsmap.config.config import Config, MapConfig, PosteriorConfig
from oddsmap.errors import ConfigError, InputError
from oddsmap.odds import logit, sigmoid
from tests.kit import ONE, add_votes, fan_scan, random_scans, votes_of

probability = st.floats(0.001, 0.999)
above, below = st.floats(0.501, 0.999), st.floats(0.001, 0.499)


def one_cell(hits: float, passes: float, **other: Any) -> LogOdds:
    evidence = EvidenceMap(1.0)
    add_votes(evidence, {(0, 0): (round(hits * ONE), round(passes * ONE))})
    return evidence.log_odds(**other)


@given(st.text("hp-", max_size=60), above, below, probability)
def test_the_recursion_equals_the_closed_form(
    readings: str, p_hit: float, p_miss: float, prior: float
) -> None:
    """l_t = l_{t-1} + inverse_sensor_model - l_0 for hits, passes and readings that say nothing."""
    sensor = BeamSensor(p_hit=p_hit, p_miss=p_miss, hit_width=0.5)
    where = {"h": 3.0, "p": 1.0, "-": 9.0}  # around, before and behind a return at 3 m
    log_odds = math.log(prior / (1 - prior))
    for reading in readings:
        p = float(sensor.inverse_model(where[reading], 3.0, prior))
        log_odds += math.log(p / (1 - p)) - math.log(prior / (1 - prior))
    view = one_cell(
        readings.count("h"), readings.count("p"), p_hit=p_hit, p_miss=p_miss, prior=prior
    )
    got = view.log_odds(((0, 0), (1, 1))).item()
    assert math.isclose(got, log_odds, rel_tol=1e-9, abs_tol=1e-9)
    want = 1 / (1 + math.exp(-log_odds)) if log_odds > -700 else 0.0
    assert math.isclose(view.probability(((0, 0), (1, 1))).item(), want, rel_tol=1e-8)


@given(probability, above, below)
def test_no_information_changes_nothing_to_the_bit(
    prior: float, p_hit: float, p_miss: float
) -> None:
    sensor = BeamSensor(p_hit=p_hit, p_miss=p_miss)
    assert sensor.inverse_model(9.0, 3.0, prior) == prior
    view = one_cell(2, 3, p_hit=p_hit, p_miss=p_miss, prior=prior)
    unseen = ((5, 5), (7, 8))
    assert (view.log_odds(unseen) == float(logit(prior))).all()
    assert np.allclose(view.probability(unseen), prior, rtol=1e-12)
    before = view.log_odds(((0, 0), (1, 1))).copy()
    view.evidence.add_cells(np.array([[0, 0]]), np.array([0]), np.array([0]))
    assert np.array_equal(view.log_odds(((0, 0), (1, 1))), before)


@given(st.integers(0, 300), st.integers(0, 300))
def test_fractions_are_weights(hits: int, passes: int) -> None:
    view = one_cell(hits / 256, passes / 256)
    want = logit(0.5) + logit(0.7) * hits / 256 + logit(0.4) * passes / 256
    assert np.allclose(view.log_odds(((0, 0), (1, 1))), want)


def test_retuning_equals_mapping_again() -> None:
    """Sensor model and prior change after mapping, as if the log had been read again."""
    scans = random_scans(4, 10)
    tuned = BeamSensor(p_hit=0.9, p_miss=0.2)
    view = build_map(scans, 0.25).log_odds(p_hit=0.9, p_miss=0.2, prior=0.1)
    again = build_map(scans, 0.25, sensor=tuned).log_odds(prior=0.1)
    first = build_map(scans, 0.25).log_odds()
    assert np.array_equal(view.log_odds(), again.log_odds())
    assert np.array_equal(view.cells()[1], again.cells()[1])
    assert not np.allclose(view.probability(), first.probability())
    assert (first.p_hit, first.p_miss, first.prior) == (0.7, 0.4, 0.5)


def test_the_view_follows_the_map() -> None:
    evidence = EvidenceMap(1.0)
    view = evidence.log_odds()
    assert view.probability().shape == (0, 0)
    add_votes(evidence, {(3, 4): (ONE, 0)})
    assert view.probability().tolist() == [[pytest.approx(0.7)]]
    add_votes(evidence, {(5, 4): (0, ONE)})
    assert np.allclose(view.probability(), [[0.7, 0.5, 0.4]])


def test_defaults_come_from_the_configuration() -> None:
    evidence = EvidenceMap(
        1.0,
        sensor=BeamSensor(p_hit=0.8, p_miss=0.3),
        posterior=PosteriorConfig(prior=0.2, free=0.1, occupied=0.9),
    )
    view = evidence.log_odds()
    assert (view.p_hit, view.p_miss, view.prior) == (0.8, 0.3, 0.2)
    assert view.thresholds == Thresholds(0.1, 0.9)
    assert evidence.config == Config(
        map=MapConfig(resolution=1.0), sensor=evidence.sensor, posterior=evidence.config.posterior
    )


def test_evidence_that_cancels_is_no_unknown() -> None:
    evidence = EvidenceMap(1.0)
    add_votes(evidence, {(0, 0): (ONE, ONE), (2, 0): (0, ONE), (3, 0): (ONE, 0)})
    view = evidence.log_odds(p_hit=0.75, p_miss=0.25)
    assert view.probability()[0, :2].tolist() == [0.5, 0.5]  # to the bit
    assert np.allclose(view.probability(), [[0.5, 0.5, 0.25, 0.75]])
    assert view.observed().tolist() == [[True, False, True, True]]
    assert view.state().tolist() == [
        [State.UNDECIDED, State.UNKNOWN, State.UNDECIDED, State.OCCUPIED]
    ]
    low = LogOdds(evidence, p_hit=0.75, p_miss=0.25, thresholds=Thresholds(0.26, 0.8))
    assert low.state().tolist() == [[State.UNDECIDED, State.UNKNOWN, State.FREE, State.UNDECIDED]]
    # A prior beyond a threshold decides about no unseen cell.
    sure = LogOdds(evidence, prior=0.01)
    assert sure.state(((1, 0), (2, 1))).tolist() == [[State.UNKNOWN]]


def test_a_scan_in_three_regions() -> None:
    evidence = build_map([fan_scan(0.5, 0.5, 0.0, [3.0])], 1.0)
    view = evidence.log_odds(prior=0.3)
    got = view.probability(((0, 0), (6, 1)))[0]
    sensor = evidence.sensor
    assert isinstance(sensor, BeamSensor)
    want = [*sensor.inverse_model([0.0, 1.0, 2.0, 3.0], 3.0, 0.3), 0.3, 0.3]
    assert np.allclose(got, want, rtol=1e-12)


@pytest.mark.parametrize(("hits", "passes"), [(10**6, 0), (0, 10**6), (10**6, 10**6)])
def test_a_million_updates(hits: int, passes: int) -> None:
    view = one_cell(hits, passes)
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        p = view.probability(((0, 0), (1, 1))).item()
        log_odds = view.log_odds(((0, 0), (1, 1))).item()
    assert math.isclose(log_odds, hits * math.log(7 / 3) + passes * math.log(2 / 3), rel_tol=1e-12)
    assert math.isfinite(log_odds)
    assert p == (0.0 if log_odds < 0 else 1.0)
    # Nothing was clamped: as many readings of the other kind bring it back.
    back = one_cell(hits, passes)
    back.evidence.merge(one_cell(hits, 0).evidence)
    assert votes_of(back.evidence)[0, 0] == (2 * hits * ONE, passes * ONE)


def test_sigmoid() -> None:
    with np.errstate(over="raise", invalid="raise"):
        assert sigmoid([0.0, 1e308, -1e308, np.inf, -np.inf]).tolist() == [0.5, 1.0, 0.0, 1.0, 0.0]
    x = np.linspace(-30, 30, 61)
    assert np.allclose(logit(sigmoid(x)), x, rtol=1e-3)
    assert np.allclose(sigmoid(x) + sigmoid(-x), 1.0, atol=1e-15)
    assert math.isclose(sigmoid(-50.0).item(), math.exp(-50.0), rel_tol=1e-12)
    assert np.allclose(sigmoid(logit([1e-12, 0.3, 0.7])), [1e-12, 0.3, 0.7], rtol=1e-12)


def test_regions_lie_as_they_are_asked_for() -> None:
    evidence = EvidenceMap(0.5)
    add_votes(evidence, {(-2, 7): (ONE, 0), (3, 9): (0, ONE)})
    view = evidence.log_odds()
    whole = view.probability()
    assert whole.shape == (3, 6)  # rows are y ascending, columns x ascending
    assert np.allclose([whole[0, 0], whole[2, 5]], [0.7, 0.4])
    assert (np.delete(whole.ravel(), [0, 17]) == 0.5).all()
    assert np.allclose(view.probability(((-3, 7), (0, 8))), [[0.5, 0.7, 0.5]])
    index, p = view.cells()
    assert index.tolist() == [[-2, 7], [3, 9]]
    assert np.allclose(p, [0.7, 0.4])
    grid = view.to_probability_map()
    assert grid.origin == (-1.0, 3.5)
    assert grid.resolution == 0.5
    assert np.array_equal(grid.probability, whole)
    assert np.array_equal(grid.observed, view.observed())


def test_xarray() -> None:
    pytest.importorskip("xarray")
    evidence = EvidenceMap(0.5)
    add_votes(evidence, {(-2, 7): (ONE, 0), (3, 9): (0, ONE)})
    array = evidence.log_odds(prior=0.4).to_xarray()
    assert (array.observed.values == evidence.log_odds().observed()).all()
    assert array.observed.dims == ("y", "x")
    assert array.dims == ("y", "x")
    assert array.x.values.tolist() == [-0.75, -0.25, 0.25, 0.75, 1.25, 1.75]
    assert array.y.values.tolist() == [3.75, 4.25, 4.75]
    assert array.x.attrs["units"] == array.y.attrs["units"] == "m"
    assert array.attrs == {"resolution": 0.5, "prior": 0.4}
    assert array.name == "probability"
    # The cell that holds a point is the one whose centre is nearest.
    p = float(array.sel(x=-0.6, y=3.9, method="nearest"))
    assert math.isclose(p, float(sigmoid(logit(0.4) + logit(0.7))))
    space = EvidenceMap(1.0, ndim=3)
    space.add_cells(np.array([[1, 2, 3]]), np.array([ONE]), np.array([0]))
    cube = space.log_odds().to_xarray(((1, 2, 3), (2, 4, 6)))
    assert cube.dims == ("z", "y", "x")
    assert cube.shape == (3, 2, 1)
    assert cube.z.values.tolist() == [3.5, 4.5, 5.5]


def test_without_xarray(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ConfigError, match=r"pip install 'oddsmap\[xarray\]'"):
        one_cell(1, 0).to_xarray()


def test_space_has_no_picture() -> None:
    space = EvidenceMap(1.0, ndim=3)
    space.add_cells(np.array([[1, 2, 3]]), np.array([ONE]), np.array([0]))
    view = space.log_odds()
    with pytest.raises(InputError, match="2D map"):
        view.to_probability_map()
    assert view.state(((1, 2, 3), (3, 3, 4))).tolist() == [[[State.OCCUPIED, State.UNKNOWN]]]


@pytest.mark.parametrize("name", ["p_hit", "p_miss", "prior"])
@pytest.mark.parametrize("value", [0.0, 1.0, -0.5, 1.5, math.nan, math.inf])
def test_bounds(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"{name} is a probability between 0 and 1"):
        one_cell(1, 1, **{name: value})


@pytest.mark.parametrize(("p_hit", "p_miss"), [(0.5, 0.4), (0.7, 0.5), (0.4, 0.7)])
def test_hits_speak_for_and_passes_against(p_hit: float, p_miss: float) -> None:
    with pytest.raises(ConfigError, match="a hit must speak for"):
        one_cell(1, 1, p_hit=p_hit, p_miss=p_miss)
