# SPDX-License-Identifier: Apache-2.0
"""Frontiers against their definition, on all kinds of maps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oddsmap
from oddsmap import ConfigError, InputError, State, Thresholds
from oddsmap.query.frontiers import find_frontiers
from oddsmap.query.places import Placed
from tests.kit import random_scans
from tests.kit3d import random_space_scans
from tests.naive.frontiers import frontiers_of

WAYS = ["sides", "corners"]
FEW = Thresholds(0.45, 0.65)  # one pass is enough


class Cells(Placed):
    def __init__(self, ndim: int, resolution: float) -> None:
        self.ndim, self.resolution = ndim, resolution


def asked(
    states: Mapping[Any, int], resolution: float = 1.0, ndim: int = 2, **options: Any
) -> list[oddsmap.Frontier]:
    """The frontiers of nothing but states."""
    index = np.array(list(states), np.int64).reshape(-1, ndim)
    parts = [(index, np.array(list(states.values()), np.int8))]
    usual: dict[str, Any] = {
        "next_to": "sides",
        "joined": "corners",
        "min_size": 0.0,
        "min_cells": 1,
        "box": None,
    }
    return find_frontiers(Cells(ndim, resolution), parts, **usual | options)


def as_sets(frontiers: list[oddsmap.Frontier]) -> set[frozenset[tuple[int, ...]]]:
    return {frozenset(map(tuple, each.cells.tolist())) for each in frontiers}


@st.composite
def worlds(draw: st.DrawFn, ndim: int) -> dict[tuple[int, ...], int]:
    """Cells on both sides of the borders of blocks, whose number is not that of cells."""
    corner = draw(st.sampled_from([-9, -1, 0, 5, 1 << 40]))
    side = 7 if ndim == 2 else 4
    cells = [tuple(corner + i for i in index) for index in np.ndindex(*(side,) * ndim)]
    kinds = st.sampled_from([State.UNKNOWN, State.FREE, State.FREE, State.OCCUPIED, 50])
    known = {cell: int(draw(kinds)) for cell in cells}
    return {cell: state for cell, state in known.items() if state != State.UNKNOWN}


@pytest.mark.parametrize("ndim", [2, 3])
@given(data=st.data())
def test_small_worlds(ndim: int, data: st.DataObject) -> None:
    states = data.draw(worlds(ndim))
    next_to, joined = data.draw(st.sampled_from(WAYS)), data.draw(st.sampled_from(WAYS))
    found = asked(states, ndim=ndim, next_to=next_to, joined=joined)
    assert as_sets(found) == frontiers_of(states, next_to, joined)
    assert [len(each.cells) for each in found] == sorted(
        (len(each.cells) for each in found), reverse=True
    )


@cache
def view_of(ndim: int) -> Any:
    scans = random_scans(1, 8) if ndim == 2 else random_space_scans(1, 8)
    return oddsmap.build_map(scans, 0.25).log_odds(thresholds=FEW)


def known(view: Any) -> dict[tuple[int, ...], int]:
    index, _ = view.cells()
    state = view.states_at(view.centre_of(index)).state
    return dict(zip(map(tuple, index.tolist()), state.tolist(), strict=True))


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("joined", WAYS)
@pytest.mark.parametrize("next_to", WAYS)
def test_maps_of_scans(next_to: Any, joined: Any, ndim: int) -> None:
    view = view_of(ndim)
    found = view.frontiers(next_to=next_to, joined=joined)
    assert as_sets(found) == frontiers_of(known(view), next_to, joined)
    assert found
    for each in found:
        centre = view.centre_of(each.cells)
        assert each.size == pytest.approx(len(centre) * 0.25 ** (ndim - 1))
        assert np.allclose(each.centroid, centre.mean(axis=0))
        far = np.linalg.norm(centre - each.centroid, axis=1)
        assert np.linalg.norm(each.goal - each.centroid) == pytest.approx(far.min())
        assert view.states_at([each.goal]).state.tolist() == [State.FREE]
        assert np.allclose(each.box[0], centre.min(axis=0) - 0.125)
        assert np.allclose(each.box[1], centre.max(axis=0) + 0.125)
        keys = each.cells[:, ::-1].tolist()
        assert keys == sorted(keys)


@pytest.mark.parametrize("ndim", [2, 3])
def test_the_order_of_scans_does_not_show(ndim: int) -> None:
    scans = random_scans(1, 8) if ndim == 2 else random_space_scans(1, 8)
    other = oddsmap.build_map(scans[::-1], 0.25).log_odds(thresholds=FEW).frontiers()
    for one, two in zip(view_of(ndim).frontiers(), other, strict=True):
        assert np.array_equal(one.cells, two.cells)


def test_small_ones_are_left_out() -> None:
    """A row of 3 free cells and one of 5, far from each other, all unknown around."""
    rows = {(x, 0): 0 for x in range(3)} | {(x, 9): 0 for x in range(5)}

    def left(**options: Any) -> list[float]:
        return [each.size for each in asked(rows, 0.1, **options)]

    assert left() == pytest.approx([0.5, 0.3])
    assert len(left(min_size=0.3)) == 2  # 0.3 / 0.1 is a little less than 3
    assert len(left(min_size=0.31)) == 1
    assert len(left(min_cells=4)) == 1
    assert left(min_cells=4, min_size=0.6) == []


def test_cells_outside_a_box_do_not_count() -> None:
    row = {(x, 0): 0 for x in range(9)}
    (all_,) = asked(row, 0.5)
    assert all_.centroid.tolist() == [2.25, 0.25]
    (part,) = asked(row, 0.5, box=((1.0, -1.0), (2.75, 1.0)))  # a centre on the last is outside
    assert part.cells.tolist() == [[2, 0], [3, 0], [4, 0]]
    assert [end.tolist() for end in part.box] == [[1.0, 0.0], [2.5, 0.5]]
    assert asked(row, 0.5, box=((9.0, 9.0), (10.0, 10.0))) == []


def test_nothing_and_all_unknown() -> None:
    assert oddsmap.EvidenceMap(0.1).log_odds().frontiers() == []
    assert oddsmap.EvidenceMap(0.1, ndim=3).log_odds().frontiers() == []


def test_other_views_of_the_same_cells() -> None:
    """Where a map lies does not change which cells are at its frontiers."""
    view = view_of(2)
    plane, want = view.to_probability_map(), view.frontiers()
    shift = view.bounds()[0]
    askew = oddsmap.ProbabilityMap(
        plane.probability, plane.observed, plane.resolution, (3.0, -2.0), math.pi / 4
    )
    for other in (plane, askew):
        for one, two in zip(want, other.frontiers(thresholds=FEW), strict=True):
            assert np.array_equal(one.cells, two.cells + shift)
    tilted = askew.frontiers(thresholds=FEW)[0]
    centre = askew.centre_of(tilted.cells)
    assert np.allclose(tilted.box[0], centre.min(axis=0) - 0.125 * math.sqrt(2.0))
    voxels = view_of(3).to_voxels()
    assert as_sets(voxels.frontiers(thresholds=FEW)) == as_sets(view_of(3).frontiers())
    few = view.frontiers(thresholds=Thresholds(0.01, 0.99))
    assert sum(len(each.cells) for each in few) < sum(len(each.cells) for each in want)


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"next_to": "edges"}, ConfigError, 'next_to is "sides"'),
        ({"joined": 8}, ConfigError, 'joined is "sides"'),
        ({"min_size": -1.0}, ConfigError, "min_size is 0 or more"),
        ({"min_size": math.nan}, ConfigError, "min_size is 0 or more"),
        ({"min_cells": 0}, ConfigError, "whole number from 1 on"),
        ({"min_cells": 2.5}, ConfigError, "metres are min_size"),
        ({"box": ((1.0, 1.0), (0.0, 2.0))}, InputError, "2 numbers"),
        ({"box": (1.0, 2.0)}, InputError, "2 numbers"),
        ({"box": ((0.0, math.nan), (1.0, 1.0))}, InputError, "2 numbers"),
    ],
)
def test_what_is_refused(options: dict[str, Any], error: Any, says: str) -> None:
    with pytest.raises(error, match=says):
        view_of(2).frontiers(**options)
