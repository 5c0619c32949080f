# SPDX-License-Identifier: Apache-2.0
"""Gibbs, MAP and joint samples with the API of the full map, against exact posteriors."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.forward.cell_grid import CellField
from oddsmap.full_map import joint_samples as joint
from oddsmap.full_map.estimator import FullMapEstimator
from oddsmap.full_map.full_map import FullMap
from oddsmap.full_map.online import OnlineFullMap
from oddsmap.scans.scan import Scan
from tests.full_map.kit import RESOLUTION, SONAR, beam, estimated, room, same, wall_of_space

LOOSE: dict[str, Any] = {"prior": 0.3, "coupling": 0.0}


def estimator(scans: list[Scan], **settings: object) -> FullMapEstimator:
    chosen = FullMapConfig(**settings)  # type: ignore[arg-type]
    config = Config(map=MapConfig(resolution=RESOLUTION), sensor=SONAR, full_map=chosen)
    made = FullMapEstimator(config)
    made.add_log(scans)
    return made


def echoes() -> list[Scan]:
    """Three near echoes of one small cone each way: a dozen of cells, all but surely solved."""
    return [beam(0.05, 0.05, heading, 0.33) for heading in (0.0, 0.05, 0.1)]


@cache
def exact(prior: float = 0.3) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Every map of the cells that the three cones list, and p(m | z) of each, without neighbours.

    Likelihoods are those of the forward model, cell by cell from the nearest.
    """
    from oddsmap.forward.beam_rows import list_rows
    from oddsmap.sensors.usable_beams import usable_beams

    model = SONAR.forward_model()
    beams, _, _ = usable_beams(echoes(), SONAR)
    field = CellField(2, 0)
    rows = list_rows(field, beams, model, RESOLUTION)
    numbers = np.unique(rows.cells)
    assert len(numbers) <= 16
    maps = (np.arange(1 << len(numbers))[:, None] >> np.arange(len(numbers))) & 1
    weight = np.prod(np.where(maps == 1, prior, 1 - prior), axis=1)
    for i in range(len(beams)):
        here, none = model.bin_likelihoods(float(beams.ranges[i]), RESOLUTION)
        likelihood, through = np.zeros(len(maps)), np.ones(len(maps))
        part = slice(rows.offsets[i], rows.offsets[i + 1])
        for cell, k, share in zip(
            rows.cells[part], rows.bins[part], rows.fractions[part], strict=True
        ):
            returns = model.detection * share * maps[:, np.searchsorted(numbers, cell)]
            likelihood += through * returns * here[k]
            through *= 1.0 - returns
        weight *= likelihood + through * none
    return field.index(numbers), np.concatenate([maps.T, [weight / weight.sum()]]).T


def at(full_map: FullMap, index: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    return np.array([full_map.probability((i, i + 1)).item() for i in index])


def test_gibbs_marginals_are_the_exact_ones() -> None:
    index, table = exact()
    truth = table[:, -1] @ table[:, :-1]
    found = estimated(echoes(), method="gibbs", samples=20_000, **LOOSE)
    np.testing.assert_allclose(at(found, index), truth, atol=0.01)
    # Message passing is near, and not there: cones share cells.
    passed = at(estimated(echoes(), **LOOSE), index)
    assert np.abs(passed - truth).max() > 0.012
    assert (found.method, found.sweeps, found.converged) == ("gibbs", 20_000, True)


def test_samples_are_of_the_joint_posterior() -> None:
    index, table = exact()
    maps, weight = table[:, :-1], table[:, -1]
    found = estimator(echoes(), burn_in=100, **LOOSE).sample(8000, every=3)
    where = {tuple(i): n for n, i in enumerate(found.index.tolist())}
    columns = [where[tuple(i)] for i in index.tolist() if tuple(i) in where]
    known = [n for n, i in enumerate(index.tolist()) if tuple(i) in where]
    assert len(columns) >= 5
    drawn = found.occupied[:, columns].astype(np.float64)
    pairs = maps[:, known].T @ (weight[:, None] * maps[:, known])
    np.testing.assert_allclose(drawn.T @ drawn / len(drawn), pairs, atol=0.025)
    apart = np.outer(np.diag(pairs), np.diag(pairs)) - pairs
    assert np.abs(apart[~np.eye(len(known), dtype=bool)]).max() > 0.05
    assert 0.0 < found.flip_rate < 1.0


def test_samples_list_the_observed_cells() -> None:
    made = estimator(room(20), burn_in=2)
    one, again = made.sample(3, every=2), made.sample(3, every=2)
    full_map = made.estimate()
    np.testing.assert_array_equal(one.index, full_map.cells()[0])
    assert one.occupied.shape == (3, full_map.cell_count)
    np.testing.assert_array_equal(one.occupied, again.occupied)
    assert (one.occupied[0] != one.occupied[1]).any()
    other = made.sample(1, every=3).occupied[0]
    assert (one.occupied[0] != other).any()
    p = full_map.cells()[1]
    assert one.occupied[:, p > 0.99].mean() > 0.9 > 0.1 > one.occupied[:, p < 0.01].mean()
    assert made.report.beams == 240
    for count, every in ((0, 1), (1, 0)):
        with pytest.raises(ConfigError, match="is at least 1, got 0"):
            made.sample(count, every=every)


def test_the_map_of_hill_climbing() -> None:
    index, table = exact()
    best = table[np.argmax(table[:, -1])]
    found = estimated(echoes(), method="map", **LOOSE)
    here = int(np.argmin(np.abs(table[:, :-1] - (at(found, index) > 0.5)).sum(axis=1)))
    np.testing.assert_array_equal(table[here, :-1], at(found, index) > 0.5)
    assert table[here, -1] > 0.9 * best[-1]
    # Each value is what log p(m | z) loses where that cell alone is turned over.
    for n, i in enumerate(index):
        turned = here ^ (1 << n)
        gap = math.log(table[here, -1]) - math.log(table[turned, -1])
        assert gap >= -1e-9
        assert abs(found.log_odds((i, i + 1)).item()) == pytest.approx(max(gap, 1e-6), abs=1e-4)
    assert (found.method, found.converged, found.residual) == ("map", True, 0.0)


@pytest.mark.parametrize("method", ["gibbs", "map"])
def test_all_methods_agree_on_a_room(method: str) -> None:
    scans = room(60)
    passed, found = estimated(scans), estimated(scans, method=method, samples=50)
    index, p = passed.cells()
    np.testing.assert_array_equal(found.cells()[0], index)  # observed does not hang on the method
    other = found.cells()[1]
    sure = np.abs(p - 0.5) > 0.45
    assert sure.mean() > 0.8
    assert ((other > 0.5) == (p > 0.5))[sure].mean() > 0.99
    assert same(found, estimated(scans, threads=2, method=method, samples=50))
    assert not same(found, passed)


def test_seeds_and_burn_in() -> None:
    scans = room(10)
    one = estimated(scans, method="gibbs", samples=3)
    assert same(one, estimated(scans, method="gibbs", samples=3))
    assert not same(one, estimated(scans, method="gibbs", samples=3, burn_in=7))
    assert not one.converged
    assert one.residual > 0.005
    assert estimated(scans, method="gibbs", samples=1).residual == 1.0


def test_space() -> None:
    scans = wall_of_space(1.5, 12)
    found = estimated(scans, method="gibbs", samples=20)
    p = estimated(scans).cells()[1]
    assert np.mean(np.abs(found.cells()[1] - p)) < 0.05


@pytest.mark.parametrize("ndim", [2, 3])
def test_neighbours(ndim: int) -> None:
    """By index, in a field whose blocks touch, have gaps, and lie on both sides of 0."""
    rng = np.random.default_rng(ndim)
    field = CellField(ndim, 0)
    field.insert(np.unique(rng.integers(-2, 1, (4, ndim)), axis=0).astype(np.int64)[::-1].copy())
    index = field.index(np.arange(len(field.belief)))
    number = {tuple(i): n for n, i in enumerate(index.tolist())}
    found = field.neighbours()
    crossed = 0
    for n in rng.integers(0, len(index), 2000):
        for way in range(2 * ndim):
            there = index[n].copy()
            there[way // 2] += 2 * (way % 2) - 1
            assert found[n, way] == number.get(tuple(there.tolist()), -1)
            crossed += found[n, way] >= 0 and bool(
                (there // field.side != index[n] // field.side).any()
            )
    assert crossed > 10
    assert (found == -1).any()


def test_every_pair_of_neighbours_is_listed_from_both_sides() -> None:
    field = CellField(2, 0)
    field.insert(np.array([[0, 0], [1, 0], [1, 1]], np.int64))
    found = field.neighbours()
    for way, back in ((0, 1), (2, 3)):
        near = np.flatnonzero(found[:, way] >= 0)
        np.testing.assert_array_equal(found[found[near, way], back], near)


def test_memory_that_would_not_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joint, "memory_limit", lambda: 1000)
    with pytest.raises(MapTooLargeError, match=r"over 240 beams would take .* sum-product"):
        estimated(room(20), method="map")


def test_bad_input() -> None:
    with pytest.raises(ConfigError, match=r"full_map\.method is one of sum-product, gibbs, map"):
        FullMapConfig(method="mean-field")
    with pytest.raises(InputError, match="no usable scan"):
        estimator([], method="gibbs").estimate()
    config = Config(
        map=MapConfig(resolution=0.1), sensor=SONAR, full_map=FullMapConfig(method="gibbs")
    )
    with pytest.raises(ConfigError, match=r"full_map\.method gibbs needs all beams at once"):
        OnlineFullMap(config)
