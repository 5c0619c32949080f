# SPDX-License-Identifier: Apache-2.0
"""Gibbs sampling under the learnt prior on windows, against exact posteriors and slow versions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.window_prior import learn, training_maps
from benchmarks.window_worlds import FAMILIES, cells_of, world
from oddsmap import open_log
from oddsmap.array_types import FloatArray
from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.errors import ConfigError
from oddsmap.forward.cell_grid import CellField
from oddsmap.full_map import gibbs_chains as chains
from oddsmap.full_map import window_prior
from oddsmap.full_map.estimator import FullMapEstimator, build_full_map
from oddsmap.full_map.full_map import load_full_map
from oddsmap.full_map.window_prior import (
    kinds_of_windows,
    lines_of,
    potentials,
    windows_of,
)
from oddsmap.kernels.infer.beam_factor import BeamRows
from oddsmap.scoring.truth import evaluate
from tests.full_map.kit import RESOLUTION, SONAR, estimated, room, same, wall_of_space
from tests.full_map.test_methods import at, echoes, exact
from tests.naive.window_prior import log_prior

WINDOWS: dict[str, Any] = {"method": "gibbs", "prior_model": "windows"}


# ---- the table ---------------------------------------------------------------------------------


def test_turns_and_mirrors_share_a_potential() -> None:
    kinds, table = kinds_of_windows(), potentials()
    assert sorted(set(kinds)) == list(range(102))
    assert len(table) == 512
    for window in range(512):
        cells = np.array([window >> bit & 1 for bit in range(9)]).reshape(3, 3)
        for alike in (cells.T, cells[::-1], cells[:, ::-1]):
            number = int(alike.ravel() @ (1 << np.arange(9)))
            assert (kinds[number], table[number]) == (kinds[window], table[window])


def potential(*rows: str) -> float:
    cells = [cell == "#" for row in rows for cell in row]
    return float(potentials()[sum(1 << bit for bit, occupied in enumerate(cells) if occupied)])


def test_what_the_table_knows() -> None:
    nothing, wall = potential("...", "...", "..."), potential("...", "###", "###")
    assert nothing > potential("...", ".#.", "...")
    assert wall > potential("#..", ".##", "#.#")
    assert wall > potential("...", "#.#", "###")


def test_learning_from_a_few_worlds() -> None:
    """The learner finds the slopes of the pseudo-likelihood to be nil, by differences."""
    maps = [cells_of(world(family, 2000))[40:70, 40:70] for family in FAMILIES]
    ridge = 1e-3
    found = learn(maps, ridge)
    kinds = kinds_of_windows()

    def loss(values: FloatArray) -> float:
        # Of each cell with two around it, all 18 windows written out.
        total, count = ridge * float(values @ values), 0
        each = 0.0
        for m in maps:
            wide = m.astype(np.int64)
            odds = np.zeros((26, 26))
            for y in range(3):
                for x in range(3):
                    code = np.zeros((26, 26), np.int64)
                    for row in range(3):
                        for column in range(3):
                            top, left = 2 - y + row, 2 - x + column
                            code += wide[top : top + 26, left : left + 26] << (3 * row + column)
                    bit = 1 << (3 * y + x)
                    odds += values[kinds[code | bit]] - values[kinds[code & ~bit]]
            mine = wide[2:-2, 2:-2]
            each += float(np.sum(np.logaddexp(0.0, odds) - mine * odds))
            count += mine.size
        return each / count + total

    best = loss(found)
    rng = np.random.default_rng(1)
    for _ in range(2):
        step = 1e-3 * rng.standard_normal(102)
        assert loss(found + step) > best
        assert loss(found + step) + loss(found - step) - 2 * best > 0
        assert abs(loss(found + step) - loss(found - step)) < 1e-9
    np.testing.assert_array_equal(found, learn(maps, ridge))
    lines = lines_of(found)
    assert len(lines) == 102
    assert lines[0].startswith("... ... ... ")


@pytest.mark.slow
def test_the_shipped_table_is_what_the_script_prints() -> None:
    """90 worlds, about 20 s of CPU time."""
    assert "\n".join(lines_of(learn(training_maps()))) == window_prior.TABLE.strip()


# ---- windows of a field ------------------------------------------------------------------------


def test_codes_and_prior_of_a_map_over_blocks() -> None:
    rng = np.random.default_rng(0)
    field = CellField(2, 0)
    field.insert(np.array([[1, 0], [0, 0], [-1, -1]], np.int64))
    met = rng.permutation(len(field.belief))[:800].astype(np.int32)
    met = np.union1d(met, [0, 31, 992, 1023]).astype(np.int32)  # corners of a block
    rows = BeamRows(
        np.empty(0), np.zeros(1, np.int64), met, np.empty(0, np.uint16), np.empty(0, np.float32)
    )
    windows, beside = windows_of(field, rows)
    np.testing.assert_array_equal(windows.cells, met)
    np.testing.assert_array_equal(
        beside[: len(field.belief)][field.neighbours() >= 0],
        field.neighbours()[field.neighbours() >= 0],
    )
    state = np.zeros(len(beside), np.uint8)
    state[met] = rng.random(len(met)) < 0.5
    index = field.index(np.arange(len(field.belief)))
    lo = index.min(axis=0)
    dense = np.zeros((index.max(axis=0) - lo + 1)[::-1], np.int64)
    x, y = (index - lo).T
    dense[y, x] = state[: len(index)]
    assert windows.log_prior(state) == pytest.approx(log_prior(dense, potentials()), abs=1e-6)


# ---- the posterior -----------------------------------------------------------------------------


def test_marginals_are_the_exact_ones() -> None:
    """By enumeration of all maps of the cells that the beams list; all others are free."""
    found = estimated(echoes(), samples=20_000, **WINDOWS)
    index, table = exact(0.5)
    maps, likelihood = table[:, :-1], table[:, -1]
    lo, hi = index.min(axis=0), index.max(axis=0) + 1
    dense = np.zeros((len(maps), *(hi - lo)[::-1]), np.int64)
    x, y = (index - lo).T
    dense[:, y, x] = maps
    weight = likelihood * np.exp(log_prior(dense, potentials()))
    truth = weight @ maps / weight.sum()
    np.testing.assert_allclose(at(found, index), truth, atol=0.01)
    assert (found.method, found.sweeps, found.converged) == ("gibbs", 20_000, True)
    # The pairs' prior is another one.
    ising = estimated(echoes(), method="gibbs", samples=2000)
    assert np.abs(at(ising, index) - truth).max() > 0.05
    # What no beam lists has the prior, as unknown cells do.
    assert found.log_odds((lo - 3, lo - 2)).item() == pytest.approx(found.prior_log_odds, abs=1e-6)


def test_sure_cells_are_drawn_seldom_and_are_as_sure(monkeypatch: pytest.MonkeyPatch) -> None:
    scans = room(40)
    seldom = estimated(scans, samples=200, **WINDOWS)
    monkeypatch.setattr(chains, "_SELDOM", 1)
    always = estimated(scans, samples=200, **WINDOWS)
    assert not same(seldom, always)
    assert np.abs(seldom.cells()[1] - always.cells()[1]).mean() < 0.01


def test_the_same_seed_and_any_threads() -> None:
    scans = room(20)
    one = estimated(scans, samples=5, **WINDOWS)
    assert same(one, estimated(scans, samples=5, threads=2, **WINDOWS))
    assert not same(one, estimated(scans, samples=5, seed=1, **WINDOWS))
    assert not same(one, estimated(scans, samples=5, burn_in=0, **WINDOWS))
    assert not same(one, estimated(scans, samples=5, method="gibbs"))


@pytest.mark.realdata
def test_it_knows_walls_better(data_folder: Path) -> None:
    """Means over all seeds are in benchmarks/README.md; this is one of them."""
    path = min((data_folder / "sonar_bench").glob("E5_*.npz"))
    with np.load(path) as arrays:
        truth, scored = arrays["truth"], arrays["scored"]
    settings = FullMapConfig(samples=30, **WINDOWS)
    found = build_full_map(open_log(path), 0.1, settings=settings)
    scores = evaluate(found.probability(((0, 0), truth.shape[::-1])), truth, scored)
    # Under the pairs' prior .044 and .64.
    assert scores.log_loss < 0.03
    assert scores.iou > 0.78


def test_samples_and_files(tmp_path: Path) -> None:
    scans = room(20)
    config = Config(
        map=MapConfig(resolution=RESOLUTION),
        sensor=SONAR,
        full_map=FullMapConfig(samples=5, **WINDOWS),
    )
    estimator = FullMapEstimator(config)
    estimator.add_log(scans)
    maps, full_map = estimator.sample(3, every=2), estimator.estimate()
    np.testing.assert_array_equal(maps.index, full_map.cells()[0])
    assert maps.occupied.shape == (3, full_map.cell_count)
    path = tmp_path / "m.zarr"
    full_map.save(path)
    again = load_full_map(path)
    assert again.config.full_map.prior_model == "windows"
    assert same(again, full_map)


# ---- where it cannot be ------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["sum-product", "map"])
def test_only_gibbs_has_it(method: str) -> None:
    with pytest.raises(ConfigError, match=f"windows is for Gibbs .* got full_map.method {method}"):
        FullMapConfig(method=method, prior_model="windows")


def test_not_in_space() -> None:
    with pytest.raises(ConfigError, match=r"prior_model windows has been learnt for 2D maps"):
        estimated(wall_of_space(1.5, 2), **WINDOWS)


def test_a_name_that_is_none() -> None:
    with pytest.raises(ConfigError, match=r"full_map\.prior_model is one of ising, windows, got"):
        FullMapConfig(prior_model="patches")
