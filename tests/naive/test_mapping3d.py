# SPDX-License-Identifier: Apache-2.0
"""The oracle of space against an even slower one, and against that of the plane."""

from __future__ import annotations

import math
from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from tests.naive import mapping
from tests.naive.mapping3d import Point, cell_of, crossed, crossed_in_box, edge_distance, map_scan

# Halves and quarters meet borders and corners on purpose; the rest is any number.
COORDINATE = st.one_of(
    st.integers(-16, 16).map(lambda i: i / 4), st.floats(-4, 4, allow_subnormal=False)
)
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE)


@given(POINT, POINT)
def test_crossings_find_the_cells_of_the_box(start: Point, end: Point) -> None:
    assert crossed(start, end) == crossed_in_box(start, end)


@given(POINT, POINT)
def test_the_shares_add_up_and_the_way_back_is_as_long(start: Point, end: Point) -> None:
    shares = crossed(start, end)
    assert sum(shares.values()) == (start != end)
    assert crossed(end, start) == shares


@given(POINT, POINT, st.tuples(*[st.integers(-5, 5)] * 3))
def test_whole_cells_move_the_answer(start: Point, end: Point, by: tuple[int, ...]) -> None:
    def moved(point: Point) -> tuple[float, ...]:
        return tuple(round((x + 8) * 64) / 64 - 8 + d for x, d in zip(point, by, strict=True))

    still = crossed(
        *(tuple(x - d for x, d in zip(moved(p), by, strict=True)) for p in (start, end))
    )
    for cell, share in crossed(moved(start), moved(end)).items():
        assert still[tuple(i - d for i, d in zip(cell, by, strict=True))] == share


@given(st.lists(st.tuples(POINT, POINT, st.booleans()), max_size=4), POINT, st.booleans())
def test_a_flat_scan_is_that_of_the_plane(
    beams: list[tuple[Point, Point, bool]], origin: Point, share: bool
) -> None:
    def flat(point: Point) -> Point:
        return (*point[:2], 0.5)

    for votes in ("scan", "beam"):
        ours = map_scan(flat(origin), [(flat(e), flat(t), h) for e, t, h in beams], votes, share)
        plane = [((e[0], e[1]), (t[0], t[1]), h) for e, t, h in beams]
        theirs = mapping.map_scan((origin[0], origin[1]), plane, votes, share)
        assert ours == {(*cell, 0): weights for cell, weights in theirs.items()}


def test_by_hand() -> None:
    assert crossed((0.5, 0.5, 0.5), (2.5, 0.5, 0.5)) == {
        (0, 0, 0): Fraction(1, 4),
        (1, 0, 0): Fraction(1, 2),
        (2, 0, 0): Fraction(1, 4),
    }
    # Through corners, nothing but the cells of the diagonal; along a border, its owner alone.
    assert list(crossed((0.0, 0.0, 0.0), (2.0, 2.0, 2.0))) == [(0, 0, 0), (1, 1, 1)]
    assert list(crossed((0.0, 1.0, 1.0), (1.0, 1.0, 1.0))) == [(0, 1, 1)]
    assert crossed((0.3, 0.3, 0.3), (0.3, 0.3, 0.3)) == {}
    assert cell_of((-0.25, 0.0, 1.0)) == (-1, 0, 1)
    here = (0.6, 0.5, 0.5)
    assert map_scan((0.5, 0.5, 0.5), [(here, here, True)], "scan") == {
        (0, 0, 0): (Fraction(1), Fraction(0))
    }


def test_edge_distance_by_hand() -> None:
    start, end = (-1.0, 0.5, 0.25), (3.0, 0.5, 0.25)
    assert edge_distance(start, end, (0, 0, 0)) == 0.25
    # Edges across the way are met, edges beside it are far.
    assert edge_distance((-1.0, 0.5, 0.0), (3.0, 0.5, 0.0), (1, 0, 0)) == 0.0
    assert edge_distance((0.5,) * 3, (0.5,) * 3, (0, 0, 0)) == math.sqrt(0.5)
