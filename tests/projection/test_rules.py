# SPDX-License-Identifier: Apache-2.0
"""What a column's cells say together: slabs, and what is said of columns left undecided."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap
from oddsmap import ConfigError, EvidenceMap, State, Thresholds, project
from tests.naive import projection as naive

ONE = 65536
R = 0.25  # a band of 2 m has 8 cells, a slab of 0.5 m has 2

Votes = dict[tuple[int, int], tuple[int, int]]


def columns(votes: Votes) -> EvidenceMap:
    """A 3D map: (column, layer) to hits and passes."""
    grid = EvidenceMap(R, ndim=3)
    index = np.array([(x, 0, z) for x, z in votes], np.int64).reshape(-1, 3)
    hits, passes = np.array(list(votes.values()), np.int64).reshape(-1, 2).T
    grid.add_cells(index, hits * ONE, passes * ONE)
    return grid


def states(votes: Votes, **options: object) -> list[int]:
    plane = project(columns(votes), 0.0, 2.0, slab=0.5, **options)  # type: ignore[arg-type]
    return [int(state) for state in plane.state()[0]]


def test_passes_of_a_slab_add_up() -> None:
    # Four passes make a cell free; here two in each cell, four in each slab of two cells.
    votes = {(0, z): (0, 2) for z in range(8)}
    assert states(votes) == [State.FREE]
    assert project(columns(votes), 0.0, 2.0, rule="largest").state()[0, 0] == State.UNDECIDED
    # Whichever cells of the slab they went through.
    assert states({(0, 2 * z): (0, 4) for z in range(4)}) == [State.FREE]
    # A slab that was passed three times is undecided, and the column with it.
    assert states({**votes, (0, 5): (0, 1)}) == [State.UNDECIDED]


def test_a_slab_never_seen_is_not_free() -> None:
    seen = {(0, z): (0, 50) for z in range(8)}
    for slab in range(4):
        left = {key: value for key, value in seen.items() if key[1] // 2 != slab}
        assert states(left) == [State.UNDECIDED]
        plane = project(columns(left), 0.0, 2.0, slab=0.5)
        assert plane.probability[0, 0] == 0.5
        assert plane.observed[0, 0]
        # One slab for all of the band: the 300 other passes are enough.
        assert project(columns(left), 0.0, 2.0, slab=math.inf).state()[0, 0] == State.FREE
    # Beyond what was seen an open end asks for nothing; between, it does.
    top = {(0, z): (0, 50) for z in range(4)}
    assert project(columns(top), 0.0, math.inf, slab=0.5).state()[0, 0] == State.FREE
    assert project(columns({**top, (0, 7): (0, 9)}), 0.0, math.inf, slab=0.5).state()[0, 0] == (
        State.UNDECIDED
    )
    assert project(columns(top), -math.inf, math.inf, slab=0.5).state()[0, 0] == State.FREE
    # A band is as high as it is, also where the map ends before; an end out of reach is none.
    for z_max, state in ((1.0, State.FREE), (1e6, State.UNDECIDED), (1e300, State.FREE)):
        assert project(columns(top), 0.0, z_max, slab=0.5).state()[0, 0] == state
    high = {(0, z): (0, 50) for z in range(400_000, 400_003)}
    assert project(columns(high), 0.0, 100_000.7, slab=0.5).state()[0, 0] == State.UNDECIDED
    assert project(columns(high), 100_000.0, 100_000.7, slab=0.5).state()[0, 0] == State.FREE


def test_one_occupied_cell_is_enough() -> None:
    votes = {(0, z): (0, 50) for z in range(8)}
    for z in range(8):
        # Passes above, below and beside it in its slab do not outvote it.
        plane = project(columns({**votes, (0, z): (2, 1)}), 0.0, 2.0)
        cell = columns({(0, z): (2, 1)}).log_odds().cells()[1][0]
        assert plane.probability[0, 0] == cell
        assert plane.state()[0, 0] == State.OCCUPIED
        # Nor one that is rather occupied than free.
        assert states({**votes, (0, z): (1, 2)}) == [State.UNDECIDED]


def test_prior_and_thresholds_decide() -> None:
    gap = columns({(0, 0): (0, 9)})
    assert project(gap.log_odds(prior=0.1), 0.0, 2.0, slab=0.5).probability[0, 0] == (
        pytest.approx(0.1, rel=1e-12)
    )
    once = columns({(0, z): (0, 1) for z in range(8)})
    plane = project(once, 0.0, 2.0, slab=0.5)
    assert plane.probability[0, 0] == pytest.approx(0.4**2 / (0.4**2 + 0.6**2), rel=1e-12)
    (note,) = plane.notes
    assert note.code == "projection.undecided"
    assert not project(once, 0.0, 2.0, slab=0.5, thresholds=Thresholds(0.35, 0.65)).notes
    # Half as high cells of the same slabs, passed by the same beams, say the same.
    fine = EvidenceMap(R / 2, ndim=3)
    index = np.array([(0, 0, 2 * z) for z in range(8)])
    fine.add_cells(index, np.zeros(8, np.int64), np.full(8, ONE))
    half = project(fine, 0.0, 2.0, slab=0.5)
    assert half.probability[0, 0] == plane.probability[0, 0]


cells = st.dictionaries(
    st.tuples(st.integers(0, 3), st.integers(0, 11)),
    st.tuples(st.integers(0, 3), st.integers(0, 6)).filter(any),
    min_size=1,
    max_size=30,
)
heights = st.sampled_from([0.0, 0.25, 0.3, 0.5, 0.8, 1.1, 9.0, math.inf])
ends = st.sampled_from([(0.0, 2.0), (0.3, 2.1), (-math.inf, 1.0), (0.5, math.inf), (0.1, 0.4)])


@settings(max_examples=200, deadline=None)
@given(cells, heights, ends, st.sampled_from([0.1, 0.5, 0.7]))
def test_against_plain_loops(
    votes: Votes, slab: float, band: tuple[float, float], prior: float
) -> None:
    view = columns(votes).log_odds(prior=prior)
    found = project(view, *band, slab=slab)
    expected = naive.project(*view.known_log_odds(), R, band, None, prior, slab)
    assert found.observed.tolist() == expected.observed.tolist()
    assert found.probability == pytest.approx(expected.probability, rel=1e-9)


@settings(max_examples=100, deadline=None)
@given(cells, heights, st.integers(0, 3), st.integers(0, 11))
def test_evidence_moves_a_column_its_own_way(votes: Votes, slab: float, x: int, z: int) -> None:
    """A hit more never makes it freer; a pass in a seen cell never more occupied."""
    before = project(columns(votes), 0.0, 3.0, slab=slab)
    hits, passes = votes.get((x, z), (0, 0))
    if (x, z) not in votes:
        return
    for more, sign in (((hits + 1, passes), 1), ((hits, passes + 1), -1)):
        after = project(columns({**votes, (x, z): more}), 0.0, 3.0, slab=slab)
        change = after.probability - before.probability
        assert (sign * change >= -1e-12).all()


def test_causes_are_counted() -> None:
    full = dict.fromkeys(range(8), (0, 9))
    votes: Votes = {(0, z): v for z, v in full.items()}
    votes |= {(1, z): v for z, v in full.items() if z < 5}  # its top
    votes |= {(2, z): v for z, v in full.items() if z > 1}  # its bottom
    votes |= {(3, z): v for z, v in full.items() if z < 6}  # its top
    votes |= {(4, z): (0, 1) for z in range(8)}
    votes |= {(5, z): v for z, v in full.items()} | {(5, 3): (1, 1)}
    votes |= {(6, 0): (5, 0), (7, 20): (1, 0)}
    (note,) = project(columns(votes), 0.0, 2.0, slab=0.5).notes
    assert note == (
        "71% of the 7 columns seen in the band are undecided, with p between 0.196 (free) and "
        "0.65 (occupied). The reasons: 0.5 m or more without a beam, mostly at the top of the band "
        "(60%), too few passes (20%), hits and passes that disagree (20%). What helps: more scans; "
        "a lower --z-max (z_max=), if the robot is no taller; a larger --slab (slab=), which may "
        "miss lower things."
    )
    assert not project(columns(votes), 0.0, 2.0, rule="largest").notes


def test_rules_that_do_not_exist() -> None:
    grid = columns({(0, 0): (0, 1)})
    with pytest.raises(ConfigError, match='rule is "slabs" or "largest", got \'mean\''):
        project(grid, 0.0, 1.0, rule="mean")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="looks at single cells"):
        project(grid, 0.0, 1.0, rule="largest", slab=0.4)
    for slab in (-0.1, math.nan):
        with pytest.raises(ConfigError, match="slab is a height of 0 m or more"):
            project(grid, 0.0, 1.0, slab=slab)


def test_ground_of_no_number_is_no_column() -> None:
    grid = columns({(x, z): (1, 0) for x in range(3) for z in range(2)})
    plane = project(
        grid, -math.inf, math.inf, ground=lambda x, y: np.where(x < R, 0.0, np.nan) + 0.0 * y
    )
    assert plane.observed.tolist() == [[True, False, False]]


def test_slabs_are_read_a_few_at_a_time() -> None:
    rng = np.random.default_rng(3)
    grid = oddsmap.EvidenceMap(0.5, ndim=3)
    index = rng.integers(-20, 20, (4000, 3)) * np.array([1, 1, 3])
    grid.add_cells(index, rng.integers(0, 2, 4000) * ONE, rng.integers(0, 3, 4000) * ONE)
    view = grid.log_odds()
    found = project(view, -30.0, 30.0, slab=1.5)
    expected = naive.project(*view.known_log_odds(), 0.5, (-30.0, 30.0), None, 0.5, 1.5)
    assert found.probability == pytest.approx(expected.probability, rel=1e-9)
