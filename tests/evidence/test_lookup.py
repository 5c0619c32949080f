# SPDX-License-Identifier: Apache-2.0
"""Votes of single cells, and cells of other grids."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import EvidenceMap
from oddsmap.errors import InputError
from oddsmap.evidence.lookup import same_places, units_at
from tests.kit import ONE, Votes, add_votes

# Near, on both sides of a tile's border, and far away.
place = st.sampled_from([-(2**40), -9, -8, -1, 0, 1, 7, 8, 31, 32, 2**40])
vote = st.sampled_from([0, 1, ONE, 3 * ONE + 5, 300 * ONE, 2**50])


@given(st.sampled_from([2, 3]), st.sampled_from([1, 5, 8, 32]), st.data())
def test_cells_have_the_votes_that_were_added(ndim: int, side: int, data: st.DataObject) -> None:
    cell = st.tuples(*[place] * ndim)
    votes: Votes = data.draw(st.dictionaries(cell, st.tuples(vote, vote), max_size=12))
    evidence = EvidenceMap(0.5, ndim=ndim, tile_side=side if ndim == 2 else min(side, 8))
    add_votes(evidence, votes)
    asked = data.draw(st.lists(cell, max_size=20)) + list(votes)
    hits, passes = units_at(evidence, np.array(asked, np.int64).reshape(-1, ndim))
    assert list(zip(hits, passes, strict=True)) == [votes.get(cell, (0, 0)) for cell in asked]


def test_wrong_shapes() -> None:
    with pytest.raises(InputError, match=r"index of shape \(n, 2\)"):
        units_at(EvidenceMap(1.0), [[1, 2, 3]])


def test_the_same_cells_and_others() -> None:
    index = np.array([[-(10**9), 0], [-1, 7], [10**9, 3]])
    assert same_places(index, 0.3, 0.3) is index
    # Half as large: centres lie on borders, and belong to the upper cell, whatever rounding does.
    cells = np.arange(-1000, 1000)[:, None]
    for r in (0.1, 0.05, 0.3, 0.7):
        assert np.array_equal(same_places(cells, r, r / 2), 2 * cells + 1)
        assert np.array_equal(same_places(cells, r, 2 * r), cells // 2)
        assert np.array_equal(same_places(cells, r, 3 * r), cells // 3)


@pytest.mark.parametrize("border", [1.0, 7.0])
def test_what_is_within_a_millionth_of_a_border_lies_above_it(border: float) -> None:
    """On both sides of the border, on both sides of the origin; a bit more is too far."""
    for off, right, left in (
        (-1.01e-6, -1, 0),
        (-0.99e-6, 0, 0),
        (0.0, 0, 0),
        (0.99e-6, 0, 0),
        (1.01e-6, 0, -1),
    ):
        # Cells 0 and -1 with this side have their centres there, right and left of the origin.
        side = 2.0 * (border + off)
        cells = same_places(np.array([[0], [-1]]), side, 1.0)
        assert cells.ravel().tolist() == [border + right, -border + left]
