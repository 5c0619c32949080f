# SPDX-License-Identifier: Apache-2.0
"""Rays through blocks of states against rational arithmetic."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.array_types import FloatArray
from oddsmap.kernels.query.rays import walk_rays
from oddsmap.kernels.query.stop_tree import SIDE_BITS
from oddsmap.odds import State
from oddsmap.query.state_blocks import bit_of, fill_blocks
from oddsmap.query.stop_tree import plant
from tests.naive.rays import Cell, first_met

FREE, UNDECIDED, OCCUPIED, UNKNOWN = (
    int(s) for s in (State.FREE, State.UNDECIDED, State.OCCUPIED, State.UNKNOWN)
)
SETS = [{OCCUPIED}, {UNKNOWN}, {OCCUPIED, UNKNOWN}, {FREE}, {UNDECIDED, OCCUPIED}]


def walk(
    states: Mapping[Cell, int], stop: set[int], starts: FloatArray, ways: FloatArray, reach: float
) -> list[tuple[float, Cell, int] | None]:
    """What the kernel finds for each ray."""
    n, d = starts.shape
    index = np.array(list(states), np.int64).reshape(-1, d)
    blocks = fill_blocks(d, [(index, np.array(list(states.values()), np.int8))])
    distance, met, ended = np.full(n, math.inf), np.zeros((n, d), np.int64), np.zeros(n, np.uint8)
    bits = np.uint8(sum(bit_of(State(state)) for state in stop))
    tree, lo, hi = plant(blocks, bits)
    walk_rays(
        blocks, tree, SIDE_BITS[d], lo, hi, starts, ways, reach, bits, np.empty(d, np.int64),
        distance, met, ended,
    )  # fmt: skip
    names = {bit_of(state): int(state) for state in State}
    return [
        (s, tuple(cell), names[bit]) if math.isfinite(s) else None
        for s, cell, bit in zip(distance.tolist(), met.tolist(), ended.tolist(), strict=True)
    ]


def agree(
    states: Mapping[Cell, int], stop: set[int], starts: FloatArray, ways: FloatArray, reach: float
) -> None:
    found = walk(states, stop, starts, ways, reach)
    for start, way, got in zip(starts, ways, found, strict=True):
        want = first_met(states, stop, start.tolist(), way.tolist(), reach)
        if want is None:
            assert got is None, (start, way)
        else:
            assert got is not None, (start, way, want)
            assert got[1:] == want[1:], (start, way)
            assert got[0] == pytest.approx(float(want[0]), rel=1e-12, abs=1e-12)


def world(rng: np.random.Generator, d: int, half: int, share: float) -> dict[Cell, int]:
    """Cells of all states in clumps that leave whole blocks empty, some far outside."""
    cells = {}
    for centre in rng.integers(-half, half, (6, d)):
        size = rng.integers(1, 9)
        for offset in np.ndindex(*(int(size),) * d):
            if rng.random() < share:
                kind = rng.choice([FREE, UNDECIDED, OCCUPIED], p=[0.8, 0.1, 0.1])
                cells[tuple((centre + offset).tolist())] = int(kind)
    return cells


@st.composite
def rays(draw: st.DrawFn, d: int) -> tuple[FloatArray, FloatArray]:
    """On a grid of eighths, so that borders, edges and corners are met exactly."""
    place = st.integers(-200, 200).map(lambda i: i / 8)
    speed = st.integers(-6, 6).map(lambda i: i / 4)
    start = draw(st.tuples(*[place] * d))
    way = draw(st.tuples(*[speed] * d).filter(any))
    return np.array([start]), np.array([way])


@pytest.mark.parametrize("d", [2, 3])
def test_rays_that_meet_borders_and_corners(d: int) -> None:
    @given(rays(d), st.integers(0, 400), st.sampled_from(SETS), st.integers(0, 2**32))
    def check(ray: tuple[FloatArray, FloatArray], reach: int, stop: set[int], seed: int) -> None:
        states = world(np.random.default_rng(seed), d, 20, 0.7)
        agree(states, stop, *ray, reach / 8)

    check()


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("stop", SETS)
def test_rays_of_any_direction(d: int, stop: set[int]) -> None:
    rng = np.random.default_rng(d)
    states = world(rng, d, 30, 0.6)
    starts, ways = rng.uniform(-40, 40, (200, d)), rng.normal(size=(200, d))
    agree(states, stop, starts, ways, 60.0)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("slope", [1e-3, 1e-9, 1e-12, 1e-17, 1e-320])
def test_nearly_level_rays_stay_in_their_row(d: int, slope: float) -> None:
    states = {(x, y, 5)[:d] if d == 2 else (x, y, 5): FREE for x in range(40) for y in range(3)}
    target = (30, 1, 5)[:d]
    states[target] = OCCUPIED
    start, way = np.full((1, d), 5.5), np.zeros((1, d))
    start[0, :2], way[0, :2] = (0.25, 1.5), (1.0, slope)
    ((s, cell, state),) = [hit for hit in walk(states, {OCCUPIED}, start, way, 50.0) if hit]
    assert (s, cell, state) == (29.75, target, OCCUPIED)


def test_diagonals_pass_between_cells_that_touch() -> None:
    """As in mapping: a touched corner gives no cell, nor does one cut by a last bit."""
    states: dict[Cell, int] = {(3, 2): OCCUPIED, (2, 3): OCCUPIED, (6, 6): OCCUPIED}
    angle = math.pi / 4
    ways = np.array([[1.0, 1.0], [math.cos(angle), math.sin(angle)]])
    for hit in walk(states, {OCCUPIED}, np.full((2, 2), 0.5), ways, 100.0):
        assert hit is not None
        assert hit[1] == (6, 6)


@pytest.mark.parametrize("far", [1 << 27, -(1 << 40)])
def test_far_from_the_origin(far: int) -> None:
    rng = np.random.default_rng(3)
    states = world(rng, 3, 15, 0.5)
    moved = {tuple(c + far for c in cell): state for cell, state in states.items()}
    # Whole 1/64 cells, which a double holds there.
    starts = np.rint(rng.uniform(-20, 20, (100, 3)) * 64) / 64
    ways = rng.normal(size=(100, 3))
    near = walk(states, {OCCUPIED}, starts, ways, 80.0)
    for one, other in zip(near, walk(moved, {OCCUPIED}, starts + far, ways, 80.0), strict=True):
        if one is None:
            assert other is None
        else:
            assert other is not None
            assert tuple(c + far for c in one[1]) == other[1]
            assert one[0] == pytest.approx(other[0], rel=1e-12)


def test_rays_without_an_end_and_maps_without_cells() -> None:
    start, ways = np.zeros((2, 2)), np.array([[1.0, 0.5], [0.0, -1.0]])
    assert walk({}, {OCCUPIED}, start, ways, math.inf) == [None, None]
    assert walk({}, {UNKNOWN}, start, ways, math.inf) == [(0.0, (0, 0), -1), (0.0, (0, -1), -1)]
    states: dict[Cell, int] = {(10**6, 500_000): OCCUPIED, (0, 0): FREE}
    far: list[Any] = walk(states, {OCCUPIED}, start + 0.5, ways, math.inf)
    assert far[0][1] == (10**6, 500_000)
    assert far[1] is None


def test_blocks_grow() -> None:
    index = 8 * np.stack(np.divmod(np.arange(5000), 70), axis=1).astype(np.int64)
    blocks = fill_blocks(
        2,
        [(index[:3000], np.zeros(3000, np.int8)), (index[3000:], np.full(2000, OCCUPIED, np.int8))],
    )
    assert blocks.counts[0] == len(blocks.coords) == 5000
    assert np.count_nonzero(blocks.present == bit_of(State.OCCUPIED) + 1) == 2000


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("stop", SETS)
def test_trees_say_which_cells_end_a_ray(d: int, stop: set[int]) -> None:
    rng = np.random.default_rng(7 + d)
    states = world(rng, d, 60, 0.9)
    # Whole leaves of one state, and cells that need more than 62 bits between them.
    states |= {tuple(np.add(cell, 64).tolist()): OCCUPIED for cell in np.ndindex(*(16,) * d)}
    states |= {(1 << 45,) * d: OCCUPIED, (-(1 << 45),) * d: FREE}
    index = np.array(list(states), np.int64)
    blocks = fill_blocks(d, [(index, np.array(list(states.values()), np.int8))])
    tree, lo, hi = plant(blocks, np.uint8(sum(bit_of(State(state)) for state in stop)))
    asked = np.concatenate([index, index + 1, index - 9, rng.integers(-200, 200, (500, d))])
    for cell in map(tuple, asked.tolist()):
        want = states.get(cell, UNKNOWN) in stop
        assert ends(tree, cell, UNKNOWN in stop) == want
        if want and UNKNOWN not in stop:
            assert all(a <= c < b for a, c, b in zip(lo, cell, hi, strict=True))


def ends(tree: Any, cell: Cell, outside: bool) -> bool:
    """What the tree says of one cell, level by level."""
    bits = SIDE_BITS[len(cell)]
    places = [
        sum(((c >> (bits * level)) % (1 << bits)) << (bits * a) for a, c in enumerate(cell))
        for level in (2, 1, 0)
    ]
    root = [c >> (3 * bits) for c in cell]
    rows = np.flatnonzero((tree.coords == root).all(axis=1))
    if len(rows) == 0:
        return outside
    row = rows[0]
    for masks, below, place in (
        (tree.roots, tree.nodes_of, places[0]),
        (tree.nodes, tree.leaves_of, places[1]),
    ):
        if not (int(masks[row]) >> place) & 1:
            return False
        row = below[row, place]
        if row < 0:
            return True
    return bool((int(tree.leaves[row]) >> places[2]) & 1)
