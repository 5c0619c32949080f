# SPDX-License-Identifier: Apache-2.0
"""Cells turned over one by one, against the posterior of whole maps."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.forward.model import ForwardModel
from oddsmap.kernels.infer.beam_factor import BeamRows
from oddsmap.kernels.infer.cell_flips import climb_sweep, conditional, gibbs_sweep
from oddsmap.kernels.infer.incremental_likelihood import (
    BeamBins,
    CellRows,
    count_bins,
    list_bins,
    renew_all,
    turn_rows,
)
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

CELLS = 6
# A grid of 3 x 2 cells: left, right, below, above.
BESIDE = np.array(
    [[-1, 1, -1, 3], [0, 2, -1, 4], [1, -1, -1, 5], [-1, 4, 0, -1], [3, 5, 1, -1], [4, -1, 2, -1]],
    np.int32,
)
FIELD = np.linspace(-1.0, 0.5, CELLS)

worlds = st.lists(beams(CELLS, most=CELLS), min_size=1, max_size=5)
maps = st.lists(st.integers(0, 1), min_size=CELLS, max_size=CELLS).map(
    lambda m: np.array(m, np.uint8)
)
couplings = st.sampled_from([0.0, 0.8])


def begin(
    rows: BeamRows, model: ForwardModel, detection: FloatArray, state: npt.NDArray[np.uint8]
) -> tuple[BeamBins, CellRows]:
    count, n = count_bins(rows), len(rows.readings)
    bins = BeamBins(
        np.empty(n + 1, np.int64), np.empty(count + 1, np.int64), np.empty(count, np.int32),
        np.empty(count), np.empty(n), np.empty(count), np.empty(count), np.empty(count),
        np.empty(n),
    )  # fmt: skip
    list_bins(rows, model.noise(RESOLUTION), bins)
    of_cells = CellRows(
        np.empty(CELLS + 1, np.int64),
        np.empty(len(rows.cells), np.int32),
        np.empty(len(rows.cells), np.float32),
    )
    turn_rows(rows, bins, of_cells)
    renew_all(rows, bins, detection, state)
    return bins, of_cells


def log_posterior(
    some: list[Beam], model: ForwardModel, detection: FloatArray, strength: float,
    state: npt.NDArray[np.uint8],
) -> float:  # fmt: skip
    """Of one map, up to a constant, every factor by itself."""
    total = float(FIELD @ state)
    for i, ways in enumerate(BESIDE):
        total += sum(strength * (state[i] == state[j]) for j in ways if j > i)
    for beam in some:
        occupied = tuple(float(state[cell]) for cell, _, _ in beam.cells)
        total += math.log(given_map(model, beam, occupied, detection))
    return total


@given(worlds, models, detections(CELLS), maps, couplings)
def test_odds_of_a_cell_given_the_others(
    some: list[Beam], model: ForwardModel, detection: FloatArray,
    state: npt.NDArray[np.uint8], strength: float,
) -> None:  # fmt: skip
    bins, of_cells = begin(rows_of(some), model, detection, state)
    out = np.empty(CELLS)
    conditional(bins, of_cells, detection, BESIDE, FIELD, strength, state, out)
    for i in range(CELLS):
        one, zero = (
            log_posterior(some, model, detection, strength,
                          np.where(np.arange(CELLS) == i, m, state).astype(np.uint8))
            for m in (1, 0)
        )  # fmt: skip
        assert abs(out[i] - (one - zero)) < 1e-6


@given(worlds, models, detections(CELLS), maps, couplings, st.integers(0, 2**32 - 1))
def test_a_sweep_draws_cells_in_turn(
    some: list[Beam], model: ForwardModel, detection: FloatArray,
    state: npt.NDArray[np.uint8], strength: float, seed: int,
) -> None:  # fmt: skip
    rows = rows_of(some)
    bins, of_cells = begin(rows, model, detection, state)
    uniform = np.random.default_rng(seed).random(CELLS)
    slow = state.copy()
    chances = np.empty(CELLS)
    for i in range(CELLS):
        log_p = []
        for m in (0, 1):
            slow[i] = m
            log_p.append(log_posterior(some, model, detection, strength, slow))
        chances[i] = 1.0 / (1.0 + math.exp(min(log_p[0] - log_p[1], 700.0)))
        slow[i] = uniform[i] < chances[i]
    before, total = state.copy(), np.ones(CELLS)
    flips = gibbs_sweep(
        rows, bins, of_cells, detection, BESIDE, FIELD, strength, uniform, state, total
    )
    np.testing.assert_array_equal(state, slow)
    np.testing.assert_allclose(total - 1.0, chances, atol=1e-6)
    assert flips == np.count_nonzero(state != before)
    # What is kept of each bin is what it would be had the map been so from the start.
    fresh, _ = begin(rows, model, detection, state)
    for kept, new in zip(bins, fresh, strict=True):
        np.testing.assert_array_equal(kept, new)


@given(worlds, models, detections(CELLS), maps, couplings)
def test_climbing_never_lowers_the_posterior(
    some: list[Beam], model: ForwardModel, detection: FloatArray,
    state: npt.NDArray[np.uint8], strength: float,
) -> None:  # fmt: skip
    rows = rows_of(some)
    bins, of_cells = begin(rows, model, detection, state)
    last = log_posterior(some, model, detection, strength, state)
    for _ in range(50):
        flips = climb_sweep(rows, bins, of_cells, detection, BESIDE, FIELD, strength, state)
        now = log_posterior(some, model, detection, strength, state)
        assert now >= last
        assert (now > last) == (flips > 0)
        last = now
        if flips == 0:
            break
    assert flips == 0
    for i in range(CELLS):
        turned = state.copy()
        turned[i] = 1 - turned[i]
        assert log_posterior(some, model, detection, strength, turned) <= last + 1e-6


@given(worlds)
def test_rows_turned_by_cell(some: list[Beam]) -> None:
    model = ForwardModel(cone_deg=20.0, range_max=1.5)
    bins, of_cells = begin(rows_of(some), model, np.ones(1), np.zeros(CELLS, np.uint8))
    found = []
    for cell in range(CELLS):
        for i in range(of_cells.offsets[cell], of_cells.offsets[cell + 1]):
            beam = int(bins.beams[of_cells.bins[i]])
            assert bins.offsets[beam] <= of_cells.bins[i] < bins.offsets[beam + 1]
            found.append((cell, beam, float(of_cells.fractions[i])))
    assert found == sorted(
        (cell, b, float(np.float32(fraction)))
        for b, beam in enumerate(some)
        for cell, _, fraction in beam.cells
    )


def test_a_reading_that_no_map_explains_says_nothing() -> None:
    """Without dropouts a no-return from behind cells that surely return it has likelihood 0."""
    model = ForwardModel(cone_deg=20.0, range_max=1.5, p_dropout=0.0, detection=1.0)
    cells = tuple((i, 4 + i, 1.0) for i in range(CELLS))
    state = np.ones(CELLS, np.uint8)
    bins, of_cells = begin(rows_of([Beam(math.inf, cells)] * 40), model, np.ones(1), state)
    out = np.empty(CELLS)
    conditional(bins, of_cells, np.ones(1), BESIDE, FIELD, 0.0, state, out)
    assert np.isfinite(out).all()
    # With one cell left nothing hides that it is free.
    state[:5] = 0
    bins, of_cells = begin(rows_of([Beam(math.inf, cells)] * 40), model, np.ones(1), state)
    conditional(bins, of_cells, np.ones(1), BESIDE, FIELD, 0.0, state, out)
    assert out[5] < -100.0
