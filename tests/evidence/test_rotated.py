# SPDX-License-Identifier: Apache-2.0
"""Maps turned by quarter turns: exact, a group, and the other way around again."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import ConfigError, EvidenceMap

ONE = 65536
Turn = npt.NDArray[np.int64]


def matrix(axes: str) -> Turn:
    words = axes.split()
    turn = np.zeros((len(words), len(words)), np.int64)
    for row, word in enumerate(words):
        turn[row, "xyz".index(word[-1])] = -1 if word[0] == "-" else 1
    return turn


def axes_of_matrix(turn: Turn) -> str:
    words = []
    for row in turn:
        (k,) = np.flatnonzero(row)
        words.append(("-" if row[k] < 0 else "") + "xyz"[k])
    return " ".join(words)


def turns(ndim: int) -> list[str]:
    found = []
    for names in permutations("xyz"[:ndim]):
        for signs in product(("", "-"), repeat=ndim):
            axes = " ".join(sign + name for sign, name in zip(signs, names, strict=True))
            if round(np.linalg.det(matrix(axes))) == 1:
                found.append(axes)
    return found


def grid(cells: dict[tuple[int, ...], tuple[int, int]], ndim: int = 3) -> EvidenceMap:
    made = EvidenceMap(0.1, ndim=ndim, votes="beam", path_lengths=True)
    index = np.array(list(cells), np.int64).reshape(-1, ndim)
    hits, passes = np.array(list(cells.values()), np.int64).reshape(-1, 2).T
    made.add_cells(index, hits, passes)
    assert made.lengths is not None
    made.lengths.add_cells(index, np.stack([0 * hits, 7 * passes + 1], axis=1))
    return made


def same(one: EvidenceMap, other: EvidenceMap) -> bool:
    return all(
        np.array_equal(a, b)
        for a, b in zip(
            (*one.cells(), *one.cell_lengths()),
            (*other.cells(), *other.cell_lengths()),
            strict=True,
        )
    )


cells = st.dictionaries(
    st.tuples(*[st.integers(-40, 40)] * 3),
    st.tuples(st.integers(1, 9 * ONE), st.integers(0, 9 * ONE)),
    min_size=1,
    max_size=12,
)


def test_there_are_24_in_space_and_4_in_the_plane() -> None:
    assert (len(turns(3)), len(turns(2))) == (24, 4)
    flat = grid({(3, -2): (1, 2), (0, 0): (5, 0)}, ndim=2)
    turned = flat
    for _ in range(4):
        turned = turned.rotated("y -x")
    assert same(turned, flat)
    assert flat.rotated("y -x").cells()[0].tolist() == [[-2, -4], [0, -1]]


@settings(max_examples=60, deadline=None)
@given(cells, st.sampled_from(turns(3)), st.sampled_from(turns(3)))
def test_a_group(cells: dict[tuple[int, ...], tuple[int, int]], one: str, other: str) -> None:
    start = grid(cells)
    both = axes_of_matrix(matrix(other) @ matrix(one))
    assert same(start.rotated(one).rotated(other), start.rotated(both))
    back = axes_of_matrix(matrix(one).T)
    assert same(start.rotated(one).rotated(back), start)
    assert same(start.rotated("x y z"), start)
    # What is there is where the rotation takes the centres.
    index, hits, passes = start.cells()
    turned = start.rotated(one)
    assert turned.census().hits == start.census().hits
    at = turned.cell_of((index + 0.5) * 0.1 @ matrix(one).T)
    for place, hit, miss in zip(at, hits, passes, strict=True):
        found = [int(kind.ravel()[0]) for kind in turned.region_units(place, place + 1)]
        assert found == [hit, miss]


@settings(max_examples=30, deadline=None)
@given(cells, cells, st.sampled_from(turns(3)))
def test_turning_goes_with_adding(
    one: dict[tuple[int, ...], tuple[int, int]],
    other: dict[tuple[int, ...], tuple[int, int]],
    axes: str,
) -> None:
    a, b = grid(one), grid(other)
    assert same((a + b).rotated(axes), a.rotated(axes) + b.rotated(axes))


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_up_points_up(up: str) -> None:
    start = grid({(5, 6, 7): (1, 0)})
    turned = start.rotated(up=up)
    (axes,) = [entry["rotated"] for entry in turned.provenance]
    assert axes.split()[2] == up
    kept = "y" if up[-1] == "x" else "x"
    assert axes.split()["xyz".index(kept)] == kept
    assert same(turned, start.rotated(axes))


def test_wrong_axes() -> None:
    space, flat = grid({(0, 0, 0): (1, 0)}), grid({(0, 0): (1, 0)}, ndim=2)
    for axes in ("x y", "x x z", "x y w", "z -x --y", "", "x y z x"):
        with pytest.raises(ConfigError, match="axes name each of x, y, z once"):
            space.rotated(axes)
    with pytest.raises(ConfigError, match="mirror image"):
        space.rotated("x y -z")
    with pytest.raises(ConfigError, match="each of x, y once"):
        flat.rotated("z -x -y")
    with pytest.raises(ConfigError, match="this one is 2D"):
        flat.rotated(up="-y")
    with pytest.raises(ConfigError, match="got 'down'"):
        space.rotated(up="down")
    for words in ({}, {"axes": "x y z", "up": "z"}):
        with pytest.raises(ConfigError, match="give one of the two"):
            space.rotated(**words)
