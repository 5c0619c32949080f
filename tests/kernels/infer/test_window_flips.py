# SPDX-License-Identifier: Apache-2.0
"""Cells drawn one by one under a prior on windows, against the posterior of whole maps."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.forward.model import ForwardModel
from oddsmap.full_map.factor_graph import FactorGraph, begin, log_joint
from oddsmap.full_map.window_prior import Windows
from oddsmap.kernels.infer.window_flips import WindowRows, draw_windows
from tests.naive.beam_factor import (
    RESOLUTION,
    Beam,
    FloatArray,
    beams,
    detections,
    given_map,
    models,
    rows_of,
)
from tests.naive.window_prior import log_prior

# A map of 3 x 2 cells comes first, then a rim of two cells around it.
NX, NY, CELLS = 3, 2, 6
PLACES = [(x, y) for y in range(NY) for x in range(NX)]
PLACES += [(x, y) for y in range(-2, NY + 2) for x in range(-2, NX + 2) if (x, y) not in PLACES]
NUMBER = {place: n for n, place in enumerate(PLACES)}
AROUND = np.array(
    [[NUMBER[x + dx, y + dy] for dy in (-1, 0, 1) for dx in (-1, 0, 1)] for x, y in PLACES[:CELLS]],
    np.int32,
)
POTENTIALS = np.random.default_rng(3).normal(0.0, 0.7, 512)
WINDOWS = Windows(np.arange(CELLS, dtype=np.int32), AROUND, POTENTIALS)

worlds = st.lists(beams(CELLS, most=CELLS), min_size=1, max_size=5)
maps = st.lists(st.integers(0, 1), min_size=CELLS, max_size=CELLS).map(np.array)


def graph_of(some: list[Beam], model: ForwardModel, detection: FloatArray) -> FactorGraph:
    chances = np.ones(len(PLACES))
    chances[:CELLS] = detection
    alone = np.full((len(PLACES), 4), -1, np.int32)
    return FactorGraph(rows_of(some), model.noise(RESOLUTION), chances, alone, windows=WINDOWS)


def padded(m: npt.NDArray[np.integer]) -> npt.NDArray[np.bool_]:
    occupied = np.zeros(len(PLACES), np.bool_)
    occupied[:CELLS] = m
    return occupied


def log_posterior(
    some: list[Beam], model: ForwardModel, detection: FloatArray, m: npt.NDArray[np.integer]
) -> float:
    """Of one map, up to a constant, every factor by itself."""
    total = float(log_prior(m.reshape(NY, NX), POTENTIALS))
    for beam in some:
        occupied = tuple(float(m[cell]) for cell, _, _ in beam.cells)
        total += math.log(given_map(model, beam, occupied, detection))
    return total


@given(worlds, models, detections(CELLS), maps)
def test_the_joint_of_a_map(
    some: list[Beam], model: ForwardModel, detection: FloatArray, m: npt.NDArray[np.int64]
) -> None:
    ours = log_joint(graph_of(some, model, detection), padded(m))
    assert abs(ours - log_posterior(some, model, detection, m)) < 1e-6


@given(worlds, models, detections(CELLS), maps, st.integers(0, 2**32 - 1), st.booleans())
def test_cells_are_drawn_in_turn(
    some: list[Beam], model: ForwardModel, detection: FloatArray, m: npt.NDArray[np.int64],
    seed: int, all_of_them: bool,
) -> None:  # fmt: skip
    graph = graph_of(some, model, detection)
    rng = np.random.default_rng(seed)
    chosen = np.arange(CELLS) if all_of_them else np.sort(rng.permutation(CELLS)[:3])
    uniform = rng.random(len(chosen))
    slow, chances = m.copy(), np.full(CELLS, 0.25)
    for at, number in zip(chosen, uniform, strict=True):
        log_p = []
        for value in (0, 1):
            slow[at] = value
            log_p.append(log_posterior(some, model, detection, slow))
        chances[at] = 1.0 / (1.0 + math.exp(min(log_p[0] - log_p[1], 700.0)))
        slow[at] = number < chances[at]
    bins, of_cells, state = begin(graph, padded(m))
    rows = WindowRows(WINDOWS.cells, AROUND, WINDOWS.steps(), WINDOWS.codes(state))
    probability = np.full(CELLS, 0.25)
    flips = draw_windows(
        graph.rows, bins, of_cells, graph.detection, rows, chosen, uniform, state, probability
    )
    np.testing.assert_array_equal(state, padded(slow))
    np.testing.assert_allclose(probability, chances, atol=1e-6)
    assert flips == np.count_nonzero(slow != m)
    # What is kept is what it would be had the map been so from the start.
    fresh, _, _ = begin(graph, padded(slow))
    for kept, new in zip(bins, fresh, strict=True):
        np.testing.assert_array_equal(kept, new)
    np.testing.assert_array_equal(rows.codes, WINDOWS.codes(state))
