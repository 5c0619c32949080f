# SPDX-License-Identifier: Apache-2.0
"""A band has the distances of a field, of all cells that have one, and keeps little else."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap
from oddsmap import ConfigError
from oddsmap.kernels.units import ONE


def grid(ndim: int, seed: int, count: int, spread: int) -> oddsmap.EvidenceMap:
    """Cells of all states, in some heaps far apart."""
    made = oddsmap.EvidenceMap(0.1, ndim=ndim)
    rng = np.random.default_rng(seed)
    made.add_cells(np.zeros((1, ndim), np.int64), np.zeros(1, np.int64), np.full(1, 4 * ONE))
    for _ in range(3):
        cells = rng.integers(-spread, spread, ndim) + rng.integers(-9, 10, (count, ndim))
        kind = rng.integers(0, 3, count)
        hits, passes = np.choose(kind, [3 * ONE, 0, ONE]), np.choose(kind, [0, 4 * ONE, 2 * ONE])
        made.add_cells(cells, hits, passes)
    return made


@settings(max_examples=40)
@given(
    st.sampled_from([2, 3]),
    st.integers(0, 2**32),
    st.sampled_from([0, 1, 30]),
    st.sampled_from([0.1, 0.35, 1.0, 2.5]),
    st.sampled_from(["occupied", ("occupied", "undecided"), "free"]),
    st.booleans(),
)
def test_the_distances_of_a_field(
    ndim: int, seed: int, count: int, max_distance: float, obstacles: Any, signed: bool
) -> None:
    view = grid(ndim, seed, count, 60 if ndim == 2 else 12).log_odds()
    band = view.distance_band(max_distance, obstacles=obstacles, signed=signed)
    lo, hi = view.bounds() or (np.zeros(ndim, np.int64),) * 2
    around = math.ceil(max_distance / 0.1) + 2
    field = view.distance_field(
        max_distance, obstacles=obstacles, signed=signed, region=(lo - around, hi + around)
    )
    index, distance = band.cells()
    want = np.isfinite(field.distance)
    assert len(index) == np.count_nonzero(want)
    assert len({tuple(cell) for cell in index.tolist()}) == len(index)
    assert np.array_equal(distance, field.at_cells(index))
    rng = np.random.default_rng(seed)
    cells = rng.integers(lo - around, hi + around, (300, ndim))
    assert np.array_equal(band.at_cells(cells), field.at_cells(cells))
    assert np.array_equal(band.at(band.centre_of(cells)), field.at_cells(cells))
    assert np.isinf(band.at_cells(np.full((1, ndim), 10**9))).all()


@pytest.mark.parametrize(("ndim", "max_distance"), [(2, 20.0), (3, 7.0)])
def test_distances_of_many_blocks(ndim: int, max_distance: float) -> None:
    view = grid(ndim, 5, 3, 200 if ndim == 2 else 40).log_odds()
    band = view.distance_band(max_distance)
    lo, hi = view.bounds() or (np.zeros(ndim, np.int64),) * 2
    around = math.ceil(max_distance / 0.1) + 2
    field = view.distance_field(max_distance, region=(lo - around, hi + around))
    index, distance = band.cells()
    assert len(index) == np.count_nonzero(np.isfinite(field.distance))
    assert np.array_equal(distance, field.at_cells(index))


def test_memory_goes_with_obstacles_and_threads_change_nothing() -> None:
    made = oddsmap.EvidenceMap(0.1, ndim=3)
    far = np.array([[0, 0, 0], [100_000, 50_000, 7], [-80_000, 3, 900]])
    made.add_cells(far, np.full(3, 3 * ONE), np.zeros(3, np.int64))
    view = made.log_odds()
    bands = [view.distance_band(1.0, signed=True, threads=n) for n in (1, 3)]
    assert bands[0].nbytes < 3 * 64 * 16**3 * 4
    for one, other in zip(bands[0].cells(), bands[1].cells(), strict=True):
        assert np.array_equal(one, other)
    assert bands[0].at_cells(far).tolist() == [-0.1] * 3
    assert bands[0].at_cells(far + np.array([0, 3, 4])).tolist() == [0.5] * 3


def test_deep_inside_a_solid_obstacle() -> None:
    made = oddsmap.EvidenceMap(0.1)
    cells = np.array(list(np.ndindex(150, 150)))
    made.add_cells(cells, np.full(len(cells), 3 * ONE), np.zeros(len(cells), np.int64))
    view = made.log_odds()
    band = view.distance_band(1.0, signed=True)
    field = view.distance_field(1.0, signed=True)
    assert np.array_equal(band.at_cells(cells), field.at_cells(cells))
    assert band.at_cells([[75, 75]]).tolist() == [-math.inf]


def test_a_turned_map() -> None:
    plane = grid(2, 5, 30, 20).log_odds().to_probability_map()
    askew = oddsmap.ProbabilityMap(plane.probability, plane.observed, 0.1, (3.0, 1.0), 0.5)
    band, field = askew.distance_band(0.7), askew.distance_field(0.7)
    cells = np.random.default_rng(0).integers(0, plane.probability.shape[0], (50, 2))
    points = askew.centre_of(cells)
    assert np.array_equal(band.cell_of(points), cells)
    assert np.allclose(band.centre_of(cells), points)
    inside = ~np.isnan(field.at(points))
    assert np.array_equal(band.at(points)[inside], field.at(points)[inside])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"max_distance": 0.0}, "above 0 and at most 2048 cells, 204.8 m here"),
        ({"max_distance": math.inf}, "at most 2048 cells"),
        ({"obstacles": ("occupied", "unknown")}, "a band around them has no end"),
        ({"obstacles": "wall"}, "one or several states"),
        ({"threads": 0}, "at least 1"),
    ],
)
def test_bands_that_are_refused(change: dict[str, Any], message: str) -> None:
    view = grid(2, 0, 3, 5).log_odds()
    with pytest.raises(ConfigError, match=message):
        view.distance_band(**{"max_distance": 1.0, **change})


def test_a_band_that_does_not_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("oddsmap.query.distance_band.memory_limit", lambda: 100)
    with pytest.raises(oddsmap.MapTooLargeError, match="give a smaller max_distance"):
        grid(2, 0, 3, 5).log_odds().distance_band(1.0)
