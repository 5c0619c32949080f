# SPDX-License-Identifier: Apache-2.0
"""Cells are named by whole numbers, everywhere; boxes that do not fit in memory are refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import EvidenceMap, ExactPosterior, InputError, MapTooLargeError, PriorArray, VoxelMap
from oddsmap import Window as WindowOfCells
from oddsmap.cell_index import cell_box, cell_indices, check_room, one_cell
from oddsmap.full_map.blocks import dense_box
from oddsmap.posterior.prior import PriorMap

ONE = 65536


def small_map() -> EvidenceMap:
    grid = EvidenceMap(0.1, votes="beam", path_lengths=True)
    grid.add_cells(np.array([[0, 0], [3, 4]]), np.array([ONE, 0]), np.array([0, ONE]))
    return grid


def voxels() -> VoxelMap:
    return VoxelMap(np.array([[0, 0, 0], [1, 2, 3]]), np.array([1.0, -1.0]), 0.1)


# Whatever takes cells, called with a first cell and one past the last.
BOXES: dict[str, Callable[[Any, Any], object]] = {
    "region": lambda lo, hi: small_map().region(lo, hi),
    "region_units": lambda lo, hi: small_map().region_units(lo, hi),
    "region_lengths": lambda lo, hi: small_map().region_lengths(lo, hi),
    "crop": lambda lo, hi: small_map().crop(lo, hi),
    "log_odds": lambda lo, hi: small_map().log_odds().log_odds((lo, hi)),
    "probability": lambda lo, hi: small_map().log_odds().probability((lo, hi)),
    "state": lambda lo, hi: small_map().log_odds().state((lo, hi)),
    "observed": lambda lo, hi: small_map().log_odds().observed((lo, hi)),
    "to_probability_map": lambda lo, hi: small_map().log_odds().to_probability_map((lo, hi)),
    "reflection": lambda lo, hi: small_map().reflection().mean((lo, hi)),
    "decay_rate": lambda lo, hi: small_map().decay_rate().mean((lo, hi)),
    "prior": lambda lo, hi: PriorMap(
        PriorArray(np.full((2, 2), 0.5), [0, 0]), small_map(), 0.5
    ).region(lo, hi),
    "full map": lambda lo, hi: dense_box(
        np.zeros((1, 2), np.int64), 32, np.zeros((1, 1024)), 0.0, lo, hi
    ),
}
LISTS: dict[str, Callable[[Any], object]] = {
    "add_cells": lambda index: small_map().add_cells(
        index, np.zeros(len(index), np.int64), np.zeros(len(index), np.int64)
    ),
    "log_odds_at": lambda index: small_map().log_odds().log_odds_at(index),
    "prior_at": lambda index: small_map().log_odds().prior_at(index),
    "prior of an array": lambda index: (
        small_map().log_odds(prior=PriorArray(np.full((2, 2), 0.5), [0, 0])).prior_at(index)
    ),
}
SINGLE: dict[str, Callable[[Any], object]] = {
    "exact posterior": lambda cell: ExactPosterior((2, 2), resolution=0.1, lo=cell),
    "prior array": lambda cell: PriorArray(np.full((2, 2), 0.5), cell),
    "window": lambda cell: WindowOfCells(np.zeros((2, 2)), 0.1, cell),
}


@pytest.mark.parametrize("name", BOXES)
def test_boxes(name: str) -> None:
    ask = BOXES[name]
    ask([0, 0], [4, 5])
    ask(np.array([0, 0], np.uint8), np.array([4, 5], np.int32))
    for lo, hi in (([0.0, 0.0], [0.4, 0.5]), ([0, 0], [4.0, 5.0]), (["0", "0"], [4, 5])):
        with pytest.raises(InputError, match=r"whole numbers, got .*cell_of\(points\)"):
            ask(lo, hi)
    with pytest.raises(InputError, match="lo <= hi of 2 indices"):
        ask([0, 0], [-1, 5])
    with pytest.raises(InputError, match="lo <= hi of 2 indices"):
        ask([0, 0, 0], [1, 1, 1])
    with pytest.raises(InputError, match=r"farther than 2\^46 cells"):
        ask([0, 0], [2**62, 5])


@pytest.mark.parametrize("name", [name for name in BOXES if name != "crop"])
def test_boxes_that_memory_cannot_hold(name: str) -> None:
    with pytest.raises(MapTooLargeError, match=r"8000000 x 8000000 cells needs .* GB"):
        BOXES[name]([0, 0], [8_000_000, 8_000_000])


def test_a_crop_may_be_as_large_as_it_likes() -> None:
    assert small_map().crop([-(2**40)] * 2, [2**40] * 2).cell_count() == 2


@pytest.mark.parametrize("name", LISTS)
def test_lists(name: str) -> None:
    ask = LISTS[name]
    ask(np.array([[0, 0], [3, 4]]))
    ask(np.empty((0, 2)))
    for wrong in ([[0.05, 0.05]], [[1.0, 2.0]], [[True, False]], [[np.nan, 0.0]]):
        with pytest.raises(InputError, match="whole numbers, got"):
            ask(np.array(wrong))
    with pytest.raises(InputError, match=r"shape \(n, 2\), got \(1, 3\)"):
        ask(np.array([[0, 0, 0]]))
    for far in (2**62, -(2**62), 2**64 - 1):
        with pytest.raises(InputError, match=r"farther than 2\^46"):
            ask(np.array([[far, far]]))


@pytest.mark.parametrize("name", SINGLE)
def test_single_cells(name: str) -> None:
    SINGLE[name]([1, -2])
    with pytest.raises(InputError, match="whole numbers"):
        SINGLE[name]([1.0, -2.0])


def test_cells_in_space() -> None:
    assert voxels().find([[1, 2, 3], [5, 5, 5]]).tolist() == [1, -1]
    for ask in (voxels().find, voxels().state_at):
        with pytest.raises(InputError, match="whole numbers"):
            ask([[1.0, 2.0, 3.0]])
    with pytest.raises(InputError, match="whole numbers"):
        voxels().cells(([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]))
    with pytest.raises(InputError, match="whole numbers"):
        VoxelMap(np.array([[0.5, 0.0, 0.0]]), np.array([1.0]), 0.1)


def test_weights_are_whole_numbers() -> None:
    with pytest.raises(InputError, match="whole numbers of 1/65536 vote"):
        small_map().add_cells(np.array([[0, 0]]), np.array([0.5]), np.array([1]))


@given(st.lists(st.tuples(*[st.integers(-3, 3)] * 2, *[st.integers(0, 3)] * 2), max_size=30))
def test_cells_given_more_than_once_add_up(rows: list[tuple[int, ...]]) -> None:
    table = np.array(rows, np.int64).reshape(-1, 4)
    at_once, one_by_one = EvidenceMap(0.1), EvidenceMap(0.1)
    at_once.add_cells(table[:, :2], table[:, 2], table[:, 3])
    for row in table[:, None]:
        one_by_one.add_cells(row[:, :2], row[:, 2], row[:, 3])
    for one, other in zip(at_once.cells(), one_by_one.cells(), strict=True):
        assert one.tolist() == other.tolist()


def test_a_sum_that_would_not_fit_is_refused() -> None:
    grid = EvidenceMap(0.1)
    with pytest.raises(MapTooLargeError, match=r"2\^46 votes"):
        grid.add_cells(np.zeros((4, 2), np.int64), np.full(4, 2**61), np.zeros(4, np.int64))
    assert grid.cell_count() == 0
    grid.add_cells(np.array([[0, 0], [5, 5]]), np.full(2, 2**61), np.zeros(2, np.int64))
    assert grid.cell_count() == 2


def test_the_functions() -> None:
    assert cell_indices([[1, 2]], 2).dtype == np.int64
    assert one_cell((1, 2, 3), 3).tolist() == [1, 2, 3]
    lo, hi = cell_box([1, 2], [1, 2], 2)
    check_room(lo, hi, 2**40)  # no cell at all
    with pytest.raises(InputError, match="got inf"):
        cell_indices([[np.inf, 0]], 2)
