# SPDX-License-Identifier: Apache-2.0
"""Two maps beside each other, against a loop over their cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap
from oddsmap import EvidenceMap, InputError, LogOdds, State, Thresholds
from oddsmap.posterior.comparison import Kind, compare, kinds_in_plane
from tests.kit import ONE, Votes, add_votes, votes_of

near = st.integers(-12, 12)
weights = st.tuples(st.integers(0, 5), st.integers(0, 9)).map(lambda v: (v[0] * ONE, v[1] * ONE))
plane = st.dictionaries(st.tuples(near, near), weights, max_size=30)
space = st.dictionaries(st.tuples(near, near, near), weights, max_size=30)
STATES = (State.FREE, State.UNDECIDED, State.OCCUPIED)


def view_of(votes: Votes, ndim: int, side: int, **options: float) -> LogOdds:
    grid = EvidenceMap(0.25, ndim=ndim, tile_side=side)
    add_votes(grid, votes)
    return grid.log_odds(**options)  # type: ignore[arg-type]


def states_of(view: LogOdds) -> dict[tuple[int, ...], tuple[State, float]]:
    index, l_odds = view.known_log_odds()
    found = {}
    for cell, value in zip(index.tolist(), l_odds.tolist(), strict=True):
        lo = np.array(cell)
        state = State(int(view.state((lo, lo + 1)).ravel()[0]))
        found[tuple(cell)] = (state, value)
    return found


@settings(max_examples=40)
@given(
    st.one_of(st.tuples(plane, plane, st.just(2)), st.tuples(space, space, st.just(3))),
    st.sampled_from([4, 8]), st.sampled_from([0.4, 0.3]),
)  # fmt: skip
def test_against_a_loop(every: tuple[Votes, Votes, int], side: int, p_miss: float) -> None:
    one, other, ndim = every
    first, second = view_of(one, ndim, 8), view_of(other, ndim, side, p_miss=p_miss)
    found = compare(first, second)
    a, b = states_of(first), states_of(second)
    both = sorted(a.keys() & b.keys())
    want = np.zeros((3, 3), int)
    for cell in both:
        want[STATES.index(a[cell][0]), STATES.index(b[cell][0])] += 1
    assert found.states.tolist() == want.tolist()
    assert (found.first_alone, found.second_alone) == (len(a) - len(both), len(b) - len(both))
    change = np.array([b[cell][1] - a[cell][1] for cell in both])
    assert found.both == len(both)
    if both:
        assert found.mean == pytest.approx(change.mean(), abs=1e-12)
        assert found.rms == pytest.approx(math.sqrt((change**2).mean()), abs=1e-12)
        assert found.largest == pytest.approx(abs(change).max(), abs=1e-12)
        assert found.agreement == np.trace(want) / len(both)
    else:
        assert all(map(math.isnan, (found.mean, found.rms, found.largest, found.agreement)))
    assert found.new == want[0, 2]
    assert found.gone == want[2, 0]
    if found.decided:
        assert found.decided_agreement == (want[0, 0] + want[2, 2]) / want[::2, ::2].sum()
    if ndim == 2 and (a or b):
        kinds_are_right(first, second)


def kinds_are_right(first: LogOdds, second: LogOdds) -> None:
    kinds, lo = kinds_in_plane(first, second)
    a, b = states_of(first), states_of(second)
    for (row, column), kind in np.ndenumerate(kinds):
        cell = (int(lo[0]) + column, int(lo[1]) + row)
        before, after = (states.get(cell, (State.UNKNOWN, 0.0))[0] for states in (a, b))
        pair = (before, after)
        if pair == (State.UNKNOWN, State.UNKNOWN):
            want = Kind.UNKNOWN
        elif State.UNKNOWN in pair:
            want = Kind.FIRST_ALONE if after == State.UNKNOWN else Kind.SECOND_ALONE
        else:
            want = {
                (State.FREE, State.FREE): Kind.FREE,
                (State.OCCUPIED, State.OCCUPIED): Kind.OCCUPIED,
                (State.FREE, State.OCCUPIED): Kind.NEW,
                (State.OCCUPIED, State.FREE): Kind.GONE,
            }.get(pair, Kind.UNDECIDED)
        assert kind == want


def test_a_map_agrees_with_itself() -> None:
    view = view_of({(0, 0): (ONE, 0), (5, 5): (0, 9 * ONE)}, 2, 8)
    found = oddsmap.compare(view, view)
    assert (found.both, found.same, found.agreement, found.decided_agreement) == (2, 2, 1.0, 1.0)
    assert (found.mean, found.rms, found.largest) == (0.0, 0.0, 0.0)
    assert votes_of(view.evidence) == {(0, 0): (ONE, 0), (5, 5): (0, 9 * ONE)}


def test_each_view_has_its_own_thresholds_and_prior() -> None:
    grid = EvidenceMap(0.25)
    add_votes(grid, {(0, 0): (ONE, 0)})
    plain = grid.log_odds()
    strict = grid.log_odds(thresholds=Thresholds(0.1, 0.9))
    assert compare(plain, strict).states.tolist() == [[0, 0, 0], [0, 0, 0], [0, 1, 0]]
    assert compare(plain, grid.log_odds(prior=0.2)).mean == pytest.approx(math.log(0.25))


def test_what_cannot_be_compared() -> None:
    view = EvidenceMap(0.25).log_odds()
    for other, said in (
        (EvidenceMap(0.5).log_odds(), "resample the finer one to 0.5 m"),
        (EvidenceMap(0.25, ndim=3).log_odds(), "3D map"),
        (EvidenceMap(0.25), r"or grid.calibrated\(\), got LogOdds and EvidenceMap"),
    ):
        with pytest.raises(InputError, match=said):
            compare(view, other)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="nothing to draw"):
        kinds_in_plane(view, view)
