# SPDX-License-Identifier: Apache-2.0
"""Costs by Nav2's formulas, against its layer written out cell by cell."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oddsmap
from oddsmap import ConfigError, Costmap, InputError, Thresholds, inflate
from tests.naive.costmap import inflated, published

ONE = 1 << 16


@given(
    st.integers(0, 2**32),
    st.tuples(st.integers(1, 12), st.integers(1, 12)),
    st.sampled_from([0.05, 0.1, 0.25]),
    st.sampled_from([0.0, 0.1, 0.22, 0.3]),
    st.sampled_from([0.3, 0.55, 1.7]),
    st.sampled_from([0.0, 3.0, 10.0]),
    st.booleans(),
    st.booleans(),
)
def test_every_cell(
    seed: int,
    shape: tuple[int, int],
    resolution: float,
    inscribed: float,
    radius: float,
    scaling: float,
    unknown: bool,
    around: bool,
) -> None:
    rng = np.random.default_rng(seed)
    kinds = np.array([0, 0, 0, 0, 0, 0, 254, 255, 255, 253, 100])
    cost = rng.choice(kinds, shape)
    found = inflate(
        cost, resolution, inscribed_radius=inscribed, inflation_radius=radius,
        cost_scaling_factor=scaling, inflate_unknown=unknown, inflate_around_unknown=around,
    )  # fmt: skip
    want = inflated(cost.tolist(), resolution, inscribed, radius, scaling, unknown, around)
    assert found.tolist() == want
    assert found.dtype == np.uint8


def grid() -> oddsmap.EvidenceMap:
    """A room: free, with a wall, a cell seen both ways, and much that is unknown."""
    made = oddsmap.EvidenceMap(0.1)
    rng = np.random.default_rng(4)
    cells = rng.integers(0, 40, (900, 2))
    none = np.zeros(len(cells), np.int64)
    made.add_cells(cells, none, none + 4 * ONE)
    wall = np.stack([np.arange(5, 35), np.full(30, 20)], axis=1)
    made.add_cells(wall, np.full(30, 9 * ONE), np.zeros(30, np.int64))
    made.add_cells(np.array([[39, 39], [0, 0]]), np.array([ONE] * 2), np.array([2 * ONE] * 2))
    return made


SETTINGS: dict[str, Any] = {"inflation_radius": 0.6, "cost_scaling_factor": 4.0}


def test_views_are_costs_and_their_inflation() -> None:
    view: Any = grid().log_odds()
    made = view.costmap(0.2, **SETTINGS)
    state = view.state()
    before = np.select([state == 100, state == 0], [254, 0], 255)
    assert np.array_equal(made.cost, inflate(before, 0.1, inscribed_radius=0.2, **SETTINGS))
    assert set(np.unique(before)) == {0, 254, 255}
    assert np.array_equal(made.lo, view.bounds()[0])
    # A part has the costs of the whole: obstacles outside it count.
    part = view.costmap(0.2, box=((0.3, 0.9), (2.0, 1.9)), **SETTINGS)
    first = made.lo[::-1]
    cut = tuple(slice(a - o, b - o) for a, b, o in zip((9, 3), (19, 20), first, strict=True))
    assert np.array_equal(part.cost, made.cost[cut])
    assert np.array_equal(part.cost, view.costmap(0.2, region=((3, 9), (20, 19)), **SETTINGS).cost)
    strict = view.costmap(0.2, thresholds=Thresholds(0.01, 0.999), **SETTINGS)
    assert (strict.cost == 255).sum() > (made.cost == 255).sum()
    free = next(x for x in range(10, 30) if state[24 - made.lo[1], x - made.lo[0]] == 0)
    points = made.centre_of(np.array([[10, 20], [free, 24], [500, 0]]))
    assert made.at(points).tolist() == [254, int(252 * math.exp(-4.0 * (4 * 0.1 - 0.2))), 255]


def test_what_lies_outside_all_known_cells_is_unknown() -> None:
    made = oddsmap.EvidenceMap(0.1)
    cells = np.array(list(np.ndindex(9, 9)))
    made.add_cells(cells, np.zeros(81, np.int64), np.full(81, 4 * ONE))
    cost = made.log_odds().costmap(0.1, inflate_around_unknown=True).cost
    assert (cost[0] == 253).all()
    assert cost[4, 4] < cost[3, 4] < cost[2, 4]
    assert (made.log_odds().costmap(0.1).cost == 0).all()


def test_files_hold_what_nav2_publishes(tmp_path: Path) -> None:
    every = Costmap(np.arange(256, dtype=np.uint8).reshape(16, 16), 0.05, np.array([-4, 7]))
    assert every.occupancy.ravel().tolist() == [published(cost) for cost in range(256)]
    every.save_ros(tmp_path / "costs.yaml")
    loaded = oddsmap.load_ros(tmp_path / "costs.yaml")
    assert np.array_equal(loaded.observed, every.cost != 255)
    read = np.where(loaded.observed, np.rint(100 * loaded.probability), -1)
    assert np.array_equal(read, every.occupancy)
    assert loaded.origin == pytest.approx((-0.2, 0.35))
    assert "mode: raw" in (tmp_path / "costs.yaml").read_text(encoding="utf-8")
    with pytest.raises(oddsmap.OutputError):
        every.save_ros(tmp_path / "costs.yaml")
    plane = grid().log_odds().to_probability_map()
    askew = oddsmap.ProbabilityMap(plane.probability, plane.observed, 0.1, (3.0, 1.0), 0.5)
    turned = askew.costmap(0.2, region=((2, 3), (30, 30)))
    turned.save_ros(tmp_path / "turned.yaml")
    back = oddsmap.load_ros(tmp_path / "turned.yaml")
    assert back.yaw == pytest.approx(0.5)
    cells = np.array([[0, 0], [10, 20]])
    assert np.allclose(back.centre_of(cells), askew.centre_of(cells + np.array([2, 3])))
    assert np.allclose(turned.centre_of(cells), askew.centre_of(cells))
    assert np.array_equal(turned.cell_of(turned.centre_of(cells)), cells)
    assert turned.at(back.centre_of(cells)).tolist() == turned.cost[(0, 20), (0, 10)].tolist()


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"cost": [[0.5]]}, InputError, "whole numbers of shape"),
        ({"cost": [1, 2]}, InputError, r"got int64 \(2,\)"),
        ({"cost": [[0, 256]]}, InputError, "0 to 255, got 0 to 256"),
        ({"resolution": 0.0}, InputError, "positive resolution"),
        ({"inscribed_radius": -0.1}, ConfigError, "inscribed_radius is at least 0"),
        ({"inscribed_radius": 0.6}, ConfigError, "less than inscribed_radius 0.6"),
        ({"inflation_radius": math.inf}, ConfigError, "finite"),
        ({"inflation_radius": 500.0}, ConfigError, "5000 cells, at most 4096: is it in metres"),
        ({"cost_scaling_factor": math.nan}, ConfigError, "cost_scaling_factor"),
        ({"threads": 0}, ConfigError, "at least 1"),
    ],
)
def test_costs_that_are_refused(change: dict[str, Any], error: Any, message: str) -> None:
    call = {"cost": [[0, 254]], "resolution": 0.1, "inscribed_radius": 0.2, **change}
    with pytest.raises(error, match=message):
        inflate(**call)


def test_maps_that_have_no_costmap() -> None:
    with pytest.raises(InputError, match="needs a 2D map, this one is 3D"):
        oddsmap.EvidenceMap(0.1, ndim=3).log_odds().costmap(0.2)
    empty = oddsmap.EvidenceMap(0.1).log_odds()
    with pytest.raises(InputError, match="no known cells"):
        empty.costmap(0.2)
    assert (empty.costmap(0.2, region=((0, 0), (2, 2))).cost == 255).all()
