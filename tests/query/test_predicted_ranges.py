# SPDX-License-Identifier: Apache-2.0
"""What maps predict along rays, against one cell at a time and against draws of the model."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import BeamSensor, ConeSensor, ConfigError, ForwardModel, InputError, MapTooLargeError
from oddsmap.array_types import FloatArray
from oddsmap.kernels.trace.cone3d import RADIUS
from tests.naive import forward as naive
from tests.naive.predictions import chance_between

CELL = 0.25
MODEL = ForwardModel(
    cone_deg=20.0, range_max=2.0, range_min=0.3, bin_width=0.125, sigma=0.1, detection=0.9,
    p_random=0.05, p_dropout=0.1,
)  # fmt: skip
RAY = BeamSensor(range_max=6.0, sigma=0.03)


@cache
def view_of(name: str, ndim: int) -> Any:
    """Cells with all kinds of evidence among cells with none."""
    rng = np.random.default_rng(ndim)
    grid = oddsmap.EvidenceMap(CELL, ndim=ndim, votes="beam")
    cells = np.unique(rng.integers(-8, 8, (150 if ndim == 2 else 1500, ndim)), axis=0)
    votes = rng.integers(0, 6, (2, len(cells))) << 16
    grid.add_cells(cells, *votes)
    view = grid.log_odds(prior=0.2) if name == "log odds" else grid.reflection(a=1.0, b=4.0)
    if name == "voxels":
        return grid.log_odds().to_voxels()
    return view


def rays_of(ndim: int, count: int, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(count, ndim))
    return rng.uniform(-1.5, 1.5, (count, ndim)), ways / np.linalg.norm(ways, axis=1)[:, None]


def echo_of(view: Any, origin: FloatArray, way: FloatArray, detection: float) -> list[float]:
    """P(first echo from each bin) along a ray, from every cell around."""
    at, half = (origin / CELL).tolist(), math.radians(MODEL.cone_deg) / 2
    width = MODEL.bin_width_at(CELL)
    far = MODEL.range_max + 5 * MODEL.sigma
    around = list(naive.around(at, far / CELL))
    chances = view.at(view.centre_of(np.array(around)))
    found = []
    for cell, p in zip(around, chances.tolist(), strict=True):
        away = naive.nearest(at, cell) * CELL + MODEL.range_bias
        if away >= far:
            continue
        if len(cell) == 2:
            fraction = naive.plane_fraction(at, math.atan2(way[1], way[0]), half, cell)
        else:
            middle = np.array(cell) + 0.5 - at
            along = float(middle @ way)
            if math.atan2(math.sqrt(max(middle @ middle - along**2, 0.0)), along) > half + 1.0:
                continue
            fraction = naive.space_fraction(at, way.tolist(), half, cell, RADIUS)
        if fraction > 0.0:
            found.append((int(away / width), detection * fraction * p))
    return naive.echo_by_bin(found, MODEL.bin_count(CELL))


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("name", ["log odds", "reflection"])
@pytest.mark.parametrize("bin_width", [None, 0.3])
def test_ranges_are_those_of_single_cells(name: str, ndim: int, bin_width: float | None) -> None:
    view, count = view_of(name, ndim), 12 if ndim == 2 else 2
    origins, ways = rays_of(ndim, count)
    found = view.range_distribution(origins, ways, MODEL, bin_width=bin_width)
    expected = view.expected_ranges(origins, ways, MODEL)
    width = MODEL.bin_width_at(CELL)
    edges = found.edges.tolist()
    assert (edges[0], edges[-1]) == (0.3, 2.0)
    rough = 1e-6 if ndim == 2 else 2e-3
    for i in range(count):
        echo = echo_of(view, origins[i], ways[i], 1.0 if name == "reflection" else MODEL.detection)
        want = [chance_between(MODEL, echo, width, low, high) for low, high in pairwise(edges)]
        assert found.probability[i] == pytest.approx(want, abs=rough)
        below = chance_between(MODEL, echo, width, -math.inf, 0.3)
        assert found.no_information[i] == pytest.approx(below, abs=rough)
        assert found.no_return[i] == pytest.approx(1.0 - sum(want) - below, abs=20 * rough)
        mean = sum(p * min((k + 0.5) * width, 2.0) for k, p in enumerate(echo))
        assert expected[i] == pytest.approx(mean + (1.0 - sum(echo)) * 2.0, abs=20 * rough)


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("sensor", [RAY, ConeSensor(cone_deg=15.0, range_max=3.0), MODEL])
def test_all_of_it_is_certain(sensor: Any, ndim: int) -> None:
    origins, ways = rays_of(ndim, 300)
    found = view_of("log odds", ndim).range_distribution(origins, ways, sensor)
    assert (found.probability >= 0.0).all()
    whole = found.probability.sum(axis=1) + found.no_return + found.no_information
    assert whole == pytest.approx(np.ones(300), abs=1e-12)
    assert found.density.shape == found.probability.shape
    assert found.density[0] @ np.diff(found.edges) == pytest.approx(found.probability[0].sum())
    assert len(found.middles) == found.probability.shape[1]


def test_readings_that_are_drawn_are_spread_like_that() -> None:
    view = view_of("log odds", 2)
    origin, way = np.array([[0.1, 0.1]]), np.array([[0.6, 0.8]])
    found = view.range_distribution(origin, way, MODEL, bin_width=0.1)
    lo, hi = (-20, -20), (20, 20)
    window = oddsmap.Window(view.probability((lo, hi)), CELL, np.array(lo))
    drawn = MODEL.simulate(
        np.repeat(origin, 40_000, 0), np.repeat(way, 40_000, 0), window, np.random.default_rng(1)
    ).ranges
    finite = drawn[np.isfinite(drawn)]
    share, _ = np.histogram(finite, found.edges)
    for got, want in (
        (share / len(drawn), found.probability[0]),
        (np.isinf(drawn).mean(), found.no_return[0]),
        (np.isnan(drawn).mean(), found.no_information[0]),
    ):
        assert got == pytest.approx(want, abs=5 * math.sqrt(0.25 / len(drawn)))


@pytest.mark.parametrize("ndim", [2, 3])
def test_where_walls_are_certain_it_is_what_rays_meet(ndim: int) -> None:
    """A box around the sensor, of cells seen a hundred times."""
    grid = oddsmap.EvidenceMap(CELL, ndim=ndim)
    inside = np.stack(np.meshgrid(*[np.arange(-9, 9)] * ndim), axis=-1).reshape(-1, ndim)
    wall = (np.abs(inside + 0.5).max(axis=1) > 8.0)[:, None]
    votes = np.where(wall, (100 << 16, 0), (0, 100 << 16))
    grid.add_cells(inside, *votes.T.copy())
    origins, ways = rays_of(ndim, 200)
    met = grid.log_odds().cast_rays(origins, ways, 6.0).distance
    sensor = BeamSensor(range_max=6.0, detection=1.0)
    expected = grid.log_odds().expected_ranges(origins, ways, sensor)
    # The range of a cell is that of its nearest point, and counts from the middle of a bin.
    assert np.abs(expected - met).max() < (1.0 if ndim == 2 else 1.5) * CELL
    if ndim == 2:
        plane = grid.log_odds().to_probability_map()
        same = plane.expected_ranges(origins, ways, sensor, unknown=0.5)
        assert same == pytest.approx(expected, abs=1e-9)


def test_batches_and_one_origin_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    from oddsmap.forward import predicted_ranges

    view, (origins, ways) = view_of("log odds", 2), rays_of(2, 100)
    whole = view.range_distribution(origins, ways, RAY)
    monkeypatch.setattr(predicted_ranges, "_BATCH_BINS", 3000)
    parts = view.range_distribution(origins, ways, RAY)
    # Sums of many rays and of few are rounded in another order.
    assert np.allclose(whole.probability, parts.probability, rtol=0.0, atol=1e-14)
    assert np.allclose(whole.no_return, parts.no_return, rtol=0.0, atol=1e-14)
    one = view.expected_ranges(origins[0], ways, RAY)
    assert np.array_equal(one, view.expected_ranges(np.tile(origins[0], (100, 1)), ways, RAY))
    assert view.expected_ranges(origins[:0], ways[:0], RAY).shape == (0,)
    assert view.range_distribution(origins[:0], ways[:0], RAY).probability.shape[0] == 0


def test_maps_without_a_prior_are_told_one() -> None:
    voxels, (origins, ways) = view_of("voxels", 3), rays_of(3, 20)
    with pytest.raises(ConfigError, match="no prior: say how probably"):
        voxels.expected_ranges(origins, ways, RAY)
    near, far = (voxels.expected_ranges(origins, ways, RAY, unknown=p) for p in (0.9, 0.0))
    assert (near < far).all()
    view = view_of("log odds", 3)
    same = view.expected_ranges(origins, ways, RAY, unknown=view.prior)
    assert np.array_equal(same, view.expected_ranges(origins, ways, RAY))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"sensor": oddsmap.OverheadSensor()}, ConfigError, "by a sensor of beams or cones"),
        ({"sensor": 30.0}, ConfigError, "got 30.0"),
        ({"sensor": BeamSensor()}, ConfigError, "range_max is needed"),
        ({"directions": [[2.0, 0.0]]}, InputError, "not of length 1"),
        ({"origins": [[math.nan, 0.0]]}, InputError, "no cell"),
        ({"unknown": 1.5}, ConfigError, "unknown is a probability"),
        ({"unknown": math.nan}, ConfigError, "unknown is a probability"),
    ],
)
def test_what_is_refused(change: dict[str, Any], error: Any, message: str) -> None:
    call = {"origins": [[0.0, 0.0]], "directions": [[1.0, 0.0]], "sensor": RAY, **change}
    view = view_of("log odds", 2)
    for ask in (view.expected_ranges, view.range_distribution):
        with pytest.raises(error, match=message):
            ask(**call)


@pytest.mark.parametrize("bin_width", [0.0, -1.0, 7.0, math.nan])
def test_bins_that_are_refused(bin_width: float) -> None:
    with pytest.raises(ConfigError, match="bin_width is a length above 0 and up to 6 m"):
        view_of("log odds", 2).range_distribution([0, 0], [[1, 0]], RAY, bin_width=bin_width)


def test_more_than_memory_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    from oddsmap.forward import predicted_ranges

    monkeypatch.setattr(predicted_ranges, "memory_limit", lambda: 700)
    with pytest.raises(MapTooLargeError, match="fewer rays at a time"):
        view_of("log odds", 2).range_distribution([0, 0], [[1, 0]], RAY)
