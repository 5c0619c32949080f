# SPDX-License-Identifier: Apache-2.0
"""Gibbs sampling and hill climbing against the exact posterior of a small world."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.forward.beams import Beams
from oddsmap.forward.model import ForwardModel
from oddsmap.forward.occupancy_box import Window
from oddsmap.full_map.exact import ExactPosterior
from oddsmap.full_map.factor_graph import FactorGraph, log_joint
from oddsmap.full_map.gibbs import conditional_log_odds, gibbs, hill_climb
from oddsmap.full_map.window_prior import Windows, potentials
from oddsmap.kernels.infer.beam_factor import BeamRows

SHAPE = (3, 3)
CELLS = 9
PRIOR, COUPLING = 0.3, 0.5
MODEL = ForwardModel(cone_deg=25.0, range_max=1.0)


@cache
def world(seed: int = 0, beam_count: int = 5) -> tuple[FactorGraph, ExactPosterior]:
    rng = np.random.default_rng(seed)
    truth = (rng.random(SHAPE) < 0.3).astype(np.float64)
    angles = rng.uniform(-math.pi, math.pi, beam_count)
    origins = 0.15 + 0.5 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    off = angles + math.pi + rng.normal(0.0, 0.15, beam_count)
    directions = np.stack([np.cos(off), np.sin(off)], axis=1)
    beams = MODEL.simulate(origins, directions, Window(truth, 0.1), rng)
    exact = ExactPosterior(SHAPE, resolution=0.1, prior=PRIOR, coupling=COUPLING)
    exact.update(beams, MODEL)
    return graph_of(beams), exact


def graph_of(beams: Beams) -> FactorGraph:
    ((_, listed),) = MODEL.cells(beams, 0.1, [0, 0], SHAPE)
    rows = BeamRows(
        beams.ranges, listed.offsets, listed.cells.astype(np.int32),
        listed.bins.astype(np.uint16), listed.fractions,
    )  # fmt: skip
    beside = np.full((CELLS, 4), -1, np.int32)
    for y in range(3):
        for x in range(3):
            for way, (dx, dy) in enumerate([(-1, 0), (1, 0), (0, -1), (0, 1)]):
                if 0 <= x + dx < 3 and 0 <= y + dy < 3:
                    beside[3 * y + x, way] = 3 * (y + dy) + x + dx
    return FactorGraph(
        rows, MODEL.noise(0.1), np.array([MODEL.detection]), beside,
        np.array([math.log(PRIOR / (1 - PRIOR))]), COUPLING,
    )  # fmt: skip


def test_the_joint_of_every_map() -> None:
    graph, exact = world()
    maps = exact.maps.reshape(-1, CELLS)
    ours = np.array([log_joint(graph, m) for m in maps])
    np.testing.assert_allclose(
        ours - ours[0], np.log(exact.probabilities) - np.log(exact.probabilities[0]), atol=1e-6
    )


@pytest.mark.parametrize("seed", [2, 5])
def test_gibbs_marginals_and_samples(seed: int) -> None:
    graph, exact = world(seed, 3)
    found = gibbs(graph, sweeps=20_000, burn_in=100, seed=seed, sample_every=2)
    np.testing.assert_allclose(found.probability, exact.marginals().ravel(), atol=0.02)
    assert found.samples.shape == (10_000, CELLS)
    # The samples are of the joint posterior: pairs of cells too, which marginals cannot say.
    maps = exact.maps.reshape(-1, CELLS).astype(np.float64)
    pairs = maps.T @ (exact.probabilities[:, None] * maps)
    samples = found.samples.astype(np.float64)
    np.testing.assert_allclose(samples.T @ samples / len(samples), pairs, atol=0.03)
    product = np.outer(exact.marginals().ravel(), exact.marginals().ravel())
    assert np.abs(pairs - product)[~np.eye(CELLS, dtype=bool)].max() > 0.1


def test_conditional_means_vary_less_than_counts() -> None:
    graph, exact = world()
    marginals = exact.marginals().ravel()
    runs = [gibbs(graph, sweeps=100, seed=seed, sample_every=1) for seed in range(40)]
    rao = np.mean([(run.probability - marginals) ** 2 for run in runs])
    counted = np.mean([(run.samples.mean(axis=0) - marginals) ** 2 for run in runs])
    assert rao < counted


def test_a_seed_gives_the_same_maps_again() -> None:
    graph, _ = world()
    one, same, other = (gibbs(graph, sweeps=50, seed=seed, sample_every=10) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.probability, same.probability)
    np.testing.assert_array_equal(one.samples, same.samples)
    assert (one.probability != other.probability).any()
    assert 0.0 < one.flip_rate < 1.0
    assert gibbs(graph, sweeps=5).samples.shape == (0, CELLS)


def test_the_start_is_forgotten_only_by_sweeps() -> None:
    graph, _ = world()
    full = np.ones(CELLS, np.bool_)
    first = [gibbs(graph, sweeps=1, burn_in=0, start=m).probability for m in (~full, full)]
    assert first[0][0] != first[1][0]
    assert full.all()


@pytest.mark.parametrize("seed", range(4))
def test_hill_climbing(seed: int) -> None:
    graph, exact = world(seed, 8)
    rng = np.random.default_rng(seed)
    best = exact.most_probable().ravel()
    for start in (None, rng.random(CELLS) < 0.5, best):
        climb = hill_climb(graph, start=start)
        begin = np.zeros(CELLS, np.bool_) if start is None else start
        assert climb.converged
        assert climb.log_joint >= log_joint(graph, begin)
        assert climb.log_joint == pytest.approx(log_joint(graph, climb.occupied), abs=1e-9)
        for i in range(CELLS):
            turned = climb.occupied.copy()
            turned[i] = ~turned[i]
            assert log_joint(graph, turned) <= climb.log_joint + 1e-6
    np.testing.assert_array_equal(climb.occupied, best)
    assert hill_climb(graph, start=exact.marginals().ravel() > 0.5).log_joint <= climb.log_joint


def test_stopping_early_is_said() -> None:
    graph, _ = world(1, 8)
    climb = hill_climb(graph, start=np.ones(CELLS, np.bool_), max_sweeps=1)
    assert climb.sweeps == 1
    assert not climb.converged


def test_without_beams_there_is_the_prior() -> None:
    none = Beams(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
    rows = BeamRows(
        none.ranges, np.zeros(1, np.int64), np.empty(0, np.int32), np.empty(0, np.uint16),
        np.empty(0, np.float32),
    )  # fmt: skip
    beside = np.full((3, 4), -1, np.int32)
    graph = FactorGraph(rows, MODEL.noise(0.1), np.ones(1), beside, np.array([-1.0, 0.0, 2.0]))
    np.testing.assert_allclose(
        gibbs(graph, sweeps=3).probability, 1 / (1 + np.exp([1.0, 0.0, -2.0]))
    )
    np.testing.assert_array_equal(hill_climb(graph).occupied, [False, False, True])


def test_bad_input() -> None:
    graph, _ = world()
    for options in ({"sweeps": 0}, {"burn_in": -1}, {"sample_every": 0}):
        with pytest.raises(ConfigError, match="sweeps >= 1"):
            gibbs(graph, **options)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="max_sweeps >= 1, got 0"):
        hill_climb(graph, max_sweeps=0)
    with pytest.raises(InputError, match=r"9 cells has shape \(9,\), got \(3, 3\)"):
        hill_climb(graph, start=np.zeros(SHAPE, np.bool_))
    with pytest.raises(InputError, match="there are 4"):
        FactorGraph(graph.rows, graph.noise, np.ones(1), graph.neighbours[:4])
    with pytest.raises(InputError, match="detection is one number or one for each of 9 cells"):
        FactorGraph(graph.rows, graph.noise, np.ones(3), graph.neighbours)


def test_a_prior_on_windows_is_for_gibbs_alone() -> None:
    graph, _ = world()
    windows = Windows(np.empty(0, np.int32), np.empty((0, 9), np.int32), potentials())
    other = dataclasses.replace(graph, windows=windows)
    with pytest.raises(ConfigError, match=r"the steps of hill climbing know .* one on windows"):
        hill_climb(other)
    with pytest.raises(ConfigError, match=r"conditional log odds know .* one on windows"):
        conditional_log_odds(other, np.zeros(CELLS, np.bool_))
