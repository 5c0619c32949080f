# SPDX-License-Identifier: Apache-2.0
"""Distance fields of views against every pair of cells; updated fields against new ones."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oddsmap
from oddsmap import ConfigError, InputError, State, Thresholds
from oddsmap.array_types import IntArray
from tests.naive.distances import cells_of, nearest_squared

ONE = 1 << 16
RESOLUTION = 0.1
# Votes that make a cell occupied, free or undecided.
VOTES = {State.OCCUPIED: (3, 0), State.FREE: (0, 4), State.UNDECIDED: (1, 2)}
SETS: list[Any] = [
    "occupied",
    ("occupied", "unknown"),
    ["unknown"],
    ("undecided", "occupied"),
    "free",
]


def add(grid: oddsmap.EvidenceMap, index: IntArray, kind: State) -> None:
    hits, passes = (np.full(len(index), votes * ONE) for votes in VOTES[kind])
    grid.add_cells(index, hits, passes)


def add_some(grid: oddsmap.EvidenceMap, seed: int, count: int, spread: int) -> None:
    rng = np.random.default_rng(seed)
    middle = rng.integers(-spread, spread + 1, grid.ndim)
    for kind in VOTES:
        n = int(rng.integers(0, count + 1))
        add(grid, middle + rng.integers(-3, 4, (n, grid.ndim)), kind)


@st.composite
def fields(draw: st.DrawFn) -> tuple[int, list[tuple[int, int, int]], dict[str, Any]]:
    """Dimension, what is added to the map step by step, and what is asked."""
    d = draw(st.sampled_from([2, 3]))
    spread = 14 if d == 2 else 3
    steps = [
        (draw(st.integers(0, 2**32)), draw(st.integers(0, 8)), spread)
        for _ in range(draw(st.integers(1, 3)))
    ]
    asked: dict[str, Any] = {
        "max_distance": draw(st.sampled_from([None, 0.1, 0.25, 0.6, 3.0, math.inf])),
        "obstacles": draw(st.sampled_from(SETS)),
        "signed": draw(st.booleans()),
    }
    if draw(st.booleans()):
        lo = np.array([draw(st.integers(-9, 9)) for _ in range(d)])
        asked["region"] = lo, lo + [draw(st.integers(0, 5)) for _ in range(d)]
    return d, steps, asked


def check(view: Any, field: oddsmap.DistanceField, asked: dict[str, Any]) -> None:
    """The field has the distances of all pairs, and those at points are the same."""
    lo, hi = field.lo, field.hi
    # Squared, in cells.
    reach = {None: None, 0.1: 1, 0.25: 6, 0.6: 36, 3.0: 900, math.inf: None}[asked["max_distance"]]
    first, past = view.bounds()
    # All that is known, and all unknown cells that may be the nearest.
    near = cells_of(np.minimum(first, lo) - 1, np.maximum(past, hi) + 1)
    states = view._states_at(near, None).state
    names = asked["obstacles"]
    kinds = [State[name.upper()] for name in ([names] if isinstance(names, str) else names)]
    is_obstacle = np.isin(states, kinds)
    cells = cells_of(lo, hi)
    signs = np.where(np.isin(view._states_at(cells, None).state, kinds), -1, 1)
    outwards = nearest_squared(cells, near[is_obstacle], reach)
    inwards = nearest_squared(cells, near[~is_obstacle], reach)
    if State.UNKNOWN not in kinds:
        assert len(inwards) == 0 or reach is not None or None not in inwards
    flat = field.squared.ravel().tolist()
    for found, sign, out, into in zip(flat, signs, outwards, inwards, strict=True):
        squared = into if sign < 0 and field.signed else out
        assert found == (sign if field.signed else 1) * (field.none if squared is None else squared)
    metres = np.where(np.abs(flat) == field.none, np.inf, np.sqrt(np.abs(flat)) * RESOLUTION)
    metres = np.copysign(metres, flat)
    assert np.array_equal(field.distance.ravel(), metres)
    assert np.array_equal(field.at(field.centre_of(cells)), metres)
    assert np.array_equal(field.at_cells(cells), metres)
    assert np.isnan(field.at_cells([lo - 1, hi])).all()


@given(fields())
def test_every_pair_and_what_is_added_later(asked: Any) -> None:
    d, steps, question = asked
    grid = oddsmap.EvidenceMap(RESOLUTION, ndim=d)
    add(grid, np.zeros((1, d), np.int64), State.FREE)
    view = grid.log_odds()
    field = view.distance_field(**question)
    check(view, field, question)
    for number, step in enumerate(steps):
        add_some(grid, *step)
        # Another view of the map, now and then.
        view = view if number % 2 == 0 else grid.log_odds(thresholds=Thresholds(0.2, 0.9))
        done = field.update(view)
        new = view.distance_field(**question)
        assert np.array_equal(field.squared, new.squared)
        assert field.squared.dtype == new.squared.dtype
        assert (field.lo.tolist(), field.hi.tolist()) == (new.lo.tolist(), new.hi.tolist())
        assert done <= math.prod(field.squared.shape)
        assert field.update(view) == 0
        check(view, new, question)


def room(size: int, d: int = 2) -> oddsmap.EvidenceMap:
    """A square of free cells with pillars."""
    grid = oddsmap.EvidenceMap(RESOLUTION, ndim=d)
    axes = [np.arange(size)] * 2 + [np.arange(4)] * (d - 2)
    add(grid, np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, d), State.FREE)
    pillars = np.stack(np.meshgrid(*[np.arange(5, size, 40)] * 2), axis=-1).reshape(-1, 2)
    add(grid, np.pad(pillars, ((0, 0), (0, d - 2))), State.OCCUPIED)
    add(grid, np.pad(pillars, ((0, 0), (0, d - 2))), State.OCCUPIED)
    return grid


@pytest.mark.parametrize("max_distance", [0.5, None])
@pytest.mark.parametrize("d", [2, 3])
def test_little_is_worked_out_anew_where_little_has_changed(
    d: int, max_distance: float | None
) -> None:
    grid = room(400, d)
    view = grid.log_odds()
    field = view.distance_field(max_distance, signed=True)
    field.update(view)  # from now on it knows of all tiles
    for cell in ([200, 100], [45, 45], [399, 0], [500, 20]):
        index = np.array([[*cell, *[1] * (d - 2)]])
        for kind in (State.OCCUPIED, State.FREE, State.FREE, State.FREE):
            add(grid, index, kind)
            done = field.update(view)
            assert np.array_equal(
                field.squared, view.distance_field(max_distance, signed=True).squared
            )
            grown = cell[0] > 400 and kind == State.OCCUPIED
            least_part = 8 if max_distance else 4
            assert done < field.squared.size // (2 if grown else least_part)


def test_a_small_box_of_a_wide_map_is_exact_without_a_largest_distance() -> None:
    grid = oddsmap.EvidenceMap(RESOLUTION)
    add(grid, np.stack([np.arange(5000), np.zeros(5000, np.int64)], axis=1), State.FREE)
    add(grid, np.array([[0, 0], [4999, 300]]), State.OCCUPIED)
    add(grid, np.array([[0, 0], [4999, 300]]), State.OCCUPIED)
    view, cells = grid.log_odds(), ((2000, 10), (2003, 12))
    field = view.distance_field(region=cells)
    want = [[x * x + y * y for x in range(2000, 2003)] for y in (10, 11)]
    assert field.squared.tolist() == want
    # An obstacle nearer than those, then another one nearer still, far outside what was looked at.
    for at in ([2000, 400], [2002, 11]):
        add(grid, np.array([at]), State.OCCUPIED)
        add(grid, np.array([at]), State.OCCUPIED)
        field.update(view)
        assert np.array_equal(field.squared, view.distance_field(region=cells).squared)
    assert field.at_cells([[2002, 10]]).tolist() == [RESOLUTION]


def test_boxes_in_metres_and_threads() -> None:
    view = room(120).log_odds()
    field = view.distance_field(box=((1.0, 2.0), (4.0, 3.0)), threads=2)
    assert (field.lo.tolist(), field.hi.tolist()) == ([10, 20], [40, 30])
    whole = view.distance_field(threads=3)
    assert np.array_equal(field.squared, whole.squared[20:30, 10:40])
    assert np.array_equal(whole.squared, view.distance_field().squared)
    assert whole.within(0.1).sum() == 9 + 4 * 9
    assert whole.within(0.0).sum() == 9
    assert np.array_equal(whole.within(1.25), whole.distance <= 1.25)
    assert whole.squared.dtype == np.int32
    with pytest.raises(ValueError, match="read-only"):
        whole.squared[0, 0] = 1


def test_other_maps_have_the_same_distances() -> None:
    grid = oddsmap.EvidenceMap(RESOLUTION)
    for seed in range(6):
        add_some(grid, seed, 8, 12)
    view = grid.log_odds()
    names: Any = ("occupied", "unknown")
    want = view.distance_field(obstacles=names, signed=True)
    plane = view.to_probability_map()
    found = plane.distance_field(obstacles=names, signed=True)
    assert np.array_equal(want.squared, found.squared)
    assert np.array_equal(found.at([[0.05, 0.05]]), want.at([[0.05, 0.05]]))
    origin = np.array(plane.origin)
    corner = tuple(origin + 0.2), tuple(origin + 0.6)
    assert plane.distance_field(box=corner).lo.tolist() == [2, 2]
    askew = oddsmap.ProbabilityMap(
        plane.probability, plane.observed, plane.resolution, (3.0, 1.0), 0.5
    )
    turned = askew.distance_field(obstacles=names, signed=True)
    assert np.array_equal(turned.squared, want.squared)
    cells = np.array([[1, 2], [4, 4]])
    assert np.array_equal(turned.at(askew.centre_of(cells)), turned.at_cells(cells))
    assert np.array_equal(turned.cell_of(turned.centre_of(cells)), cells)
    with pytest.raises(InputError, match=r"turned.*give region= in cells"):
        askew.distance_field(box=corner)
    with pytest.raises(InputError, match="lies elsewhere: make a new field"):
        turned.update(plane)
    reflection = grid.reflection()
    field = reflection.distance_field()
    assert np.array_equal(field.squared == 0, reflection.state() == State.OCCUPIED)
    cube = oddsmap.EvidenceMap(RESOLUTION, ndim=3)
    for seed in range(6):
        add_some(cube, seed, 8, 4)
    space = cube.log_odds()
    of_voxels = space.to_voxels().distance_field(0.5, region=((-3, -3, -3), (3, 3, 3)))
    assert np.array_equal(
        of_voxels.squared, space.distance_field(0.5, region=((-3, -3, -3), (3, 3, 3))).squared
    )


def test_a_field_can_be_pickled() -> None:
    view = room(60).log_odds()
    field = view.distance_field(1.0)
    copy = pickle.loads(pickle.dumps(field))
    assert np.array_equal(copy.squared, field.squared)
    assert len(pickle.dumps(field)) < 3 * field.nbytes
    assert copy.update(view) == field.update(view) == 0


def test_an_update_that_fails_is_not_taken_for_one(monkeypatch: pytest.MonkeyPatch) -> None:
    grid = room(60)
    view = grid.log_odds()
    field = view.distance_field(1.0)
    add(grid, np.array([[10, 10]] * 3), State.OCCUPIED)

    def fail(*_: object) -> None:
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr("oddsmap.query.distance_field.squared_to", fail)
        with pytest.raises(MemoryError):
            field.update(view)
    for ask in (lambda: field.squared, lambda: field.distance, lambda: field.at([[1.0, 1.0]])):
        with pytest.raises(InputError, match="did not end: update it again"):
            ask()
    field.update(view)
    assert np.array_equal(field.squared, view.distance_field(1.0).squared)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"max_distance": 0.0}, ConfigError, "length above 0"),
        ({"max_distance": math.nan}, ConfigError, "length above 0"),
        ({"max_distance": 1e12}, ConfigError, "more than 2.30: None asks for any"),
        ({"threads": 0}, ConfigError, "at least 1"),
        ({"obstacles": "wall"}, ConfigError, "one or several states, occupied, unknown"),
        ({"obstacles": ()}, ConfigError, "one or several states"),
        ({"box": ((0.0, 0.0), (0.0, 1.0))}, InputError, "lowest corner"),
        ({"box": ((0, 0), (1, 1)), "region": ((0, 0), (1, 1))}, InputError, "not both"),
        ({"region": ((0.0, 0.0), (1.0, 1.0))}, InputError, "whole numbers"),
        ({"region": ((1 << 40, 0), (1 + (1 << 40), 1))}, InputError, "cells apart"),
    ],
)
def test_questions_that_are_refused(change: dict[str, Any], error: Any, message: str) -> None:
    with pytest.raises(error, match=message):
        room(10).log_odds().distance_field(**change)


def test_maps_without_cells() -> None:
    view = oddsmap.EvidenceMap(RESOLUTION).log_odds()
    with pytest.raises(InputError, match="no known cells: say with box="):
        view.distance_field()
    region = (0, 0), (2, 2)
    assert np.isinf(view.distance_field(region=region).distance).all()
    unknown = view.distance_field(obstacles="unknown", region=region, signed=True)
    assert (unknown.distance == -np.inf).all()
    far = (1 << 40, 0), (1 + (1 << 40), 1)
    assert np.isinf(room(10).log_odds().distance_field(5.0, region=far).distance).all()
    with pytest.raises(ConfigError, match="at most 5"):
        room(10).log_odds().distance_field(5.0).within(6.0)
