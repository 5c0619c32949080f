# SPDX-License-Identifier: Apache-2.0
"""Maps moved by poses: exact for whole cells, else as each new cell asks of an old one."""

from __future__ import annotations

import math
import warnings
from itertools import permutations, product
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import EvidenceMap, InputError, Pose3
from oddsmap.poses.pose import Pose, Pose2, quaternion_xyzw
from tests.kit import ONE, Votes, add_votes, votes_of
from tests.naive.moved_cells import moved_votes

SIDE = 0.25
near = st.integers(-12, 12)
weights = st.tuples(st.integers(1, 300 * ONE), st.integers(0, 9 * ONE))
plane = st.dictionaries(st.tuples(near, near), weights, min_size=1, max_size=8)
space = st.dictionaries(st.tuples(near, near, near), weights, min_size=1, max_size=5)
whole = st.integers(-50, 50)
metres = st.floats(-3.0, 3.0)
few = settings(max_examples=40, deadline=None)

TURNS: list[npt.NDArray[np.float64]] = [
    turn
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(turn := np.diag(signs)[list(order)]) > 0
]


def map_of(votes: Votes, *, lengths: bool = False) -> EvidenceMap:
    ndim = len(next(iter(votes)))
    grid = EvidenceMap(SIDE, votes="beam", ndim=ndim, path_lengths=lengths)
    add_votes(grid, votes)
    if grid.lengths is not None:
        for at, (hits, passes) in votes.items():
            grid.lengths.add_cells(np.array([at]), np.array([[0, hits + 7 * passes]]))
    return grid


def moved(grid: EvidenceMap, pose: Any) -> EvidenceMap:
    """Moved, whether or not it warns."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return grid.transformed(pose)


def exactly(grid: EvidenceMap, pose: Any) -> EvidenceMap:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return grid.transformed(pose)


def lengths_of(grid: EvidenceMap) -> dict[tuple[int, ...], int]:
    index, lengths = grid.cell_lengths()
    return dict(zip(map(tuple, index.tolist()), lengths.tolist(), strict=True))


poses_of_planes = st.builds(
    lambda turns, x, y: Pose2(x * SIDE, y * SIDE, turns * math.pi / 2), st.integers(-5, 5), whole,
    whole,
)  # fmt: skip
poses_of_spaces = st.builds(
    lambda turn, *at: Pose3(SIDE * np.array(at), turn), st.sampled_from(TURNS), whole, whole, whole
)
exact = st.one_of(
    st.tuples(plane, plane, poses_of_planes), st.tuples(space, space, poses_of_spaces)
)


def test_all_turns_are_there() -> None:
    assert len(TURNS) == 24


@few
@given(exact)
def test_whole_cells_go_to_whole_cells(given: tuple[Votes, Votes, Pose]) -> None:
    votes, more, pose = given
    grid, other = (map_of(each, lengths=True) for each in (votes, more))
    there = exactly(grid, pose)
    # Each cell is where the pose takes its centre.
    centres = (np.array(list(votes)) + 0.5) * SIDE
    want = np.floor(pose.transform(centres) / SIDE).astype(int).tolist()
    assert votes_of(there) == dict(zip(map(tuple, want), votes.values(), strict=True))
    assert sorted(lengths_of(there)) == sorted(map(tuple, want))
    back = exactly(there, pose.inverse())
    assert votes_of(back) == votes
    assert lengths_of(back) == lengths_of(grid)
    both = exactly(grid + other, pose)
    assert votes_of(both) == votes_of(there + exactly(other, pose))
    assert lengths_of(both) == lengths_of(there + exactly(other, pose))


@few
@given(plane, st.builds(Pose2, metres, metres, st.floats(-4.0, 4.0)), plane)
def test_planes_between_cells(votes: Votes, pose: Pose2, more: Votes) -> None:
    against_the_oracle(votes, pose, more)


@settings(max_examples=25, deadline=None)
@given(space, st.tuples(*3 * [metres]), st.tuples(*4 * [st.floats(-1.0, 1.0)]), space)
def test_spaces_between_cells(
    votes: Votes, at: tuple[float, ...], turn: tuple[float, ...], more: Votes
) -> None:
    norm = math.hypot(*turn)
    xyzw = (0.0, 0.0, 0.6, 0.8) if norm < 0.1 else tuple(q / norm for q in turn)
    against_the_oracle(votes, Pose3.from_quaternion_xyzw(at, xyzw), more)


def against_the_oracle(votes: Votes, pose: Pose, more: Votes) -> None:
    grid, other = map_of(votes), map_of(more)
    found = moved(grid, pose)
    entry: dict[str, Any] = found.provenance[-1] if found.provenance else {"exact": True}
    if isinstance(pose, Pose3):  # as it is used: of a rotation that is one to the last digit
        xyzw = quaternion_xyzw(pose.rotation)
        pose = Pose3.from_quaternion_xyzw(pose.translation, xyzw)
    want, taken = moved_votes(votes, pose.rotation.tolist(), (pose.translation / SIDE).tolist())
    assert votes_of(found) == want
    if not entry["exact"]:
        assert entry["resampling"] == {
            "cells": len(votes),
            "repeated": sum(times > 1 for times in taken.values()),
            "dropped": sum(times == 0 for times in taken.values()),
            "votes_before": sum(map(sum, votes.values())) / ONE,
            "votes": sum(map(sum, want.values())) / ONE,
        }
    # What is moved adds up as what is not: whether or not the sum is exact where a part is.
    assert votes_of(moved(grid + other, pose)) == votes_of(found + moved(other, pose))


def test_a_shift_between_cells_keeps_all_counts() -> None:
    votes: Votes = {(i, j): (ONE * i, ONE * j + ONE) for i in range(9) for j in range(9)}
    with pytest.warns(UserWarning, match="of 81 cells the counts of 0 are repeated and those of 0"):
        found = map_of(votes).transformed((0.3 * SIDE, 4.6 * SIDE, 0.0))
    assert votes_of(found) == {(i, j + 5): vote for (i, j), vote in votes.items()}


def test_one_warning_says_the_cost() -> None:
    votes: Votes = {(i, j): (ONE, 2 * ONE) for i in range(30) for j in range(30)}
    with pytest.warns(UserWarning, match="resampled") as caught:
        found = map_of(votes).transformed((0.0, 0.0, 0.3))
    (said,) = [str(one.message) for one in caught]
    cost = found.provenance[-1]["resampling"]
    assert 0 < cost["dropped"] < 90
    assert f"of 900 cells the counts of {cost['repeated']} are repeated" in said
    assert f"those of {cost['dropped']} dropped, 2700 votes became {cost['votes']:.0f};" in said
    assert set(votes_of(found).values()) == {(ONE, 2 * ONE)}


def test_turns_with_few_digits_are_meant() -> None:
    """1.5708 is off by 4e-6: not by a hundredth of a cell until 2700 cells away."""
    for reach, is_exact in ((2000, True), (9000, False)):
        grid = map_of({(0, 0): (ONE, 0), (reach, 3): (0, ONE)})
        found = moved(grid, (2.0, 0.0, 1.5708))
        assert found.provenance[-1]["exact"] == is_exact
        assert votes_of(found) == {(7, 0): (ONE, 0), (4, reach): (0, ONE)}
    # Far from the origin what matters is what happens to the map, not to the origin.
    far = map_of({(4_000_000, 7): (ONE, 0), (4_000_010, 9): (0, ONE)})
    place = SIDE * np.array([4_000_000.5, 7.5])
    turn = Pose2(0.0, 0.0, 1.5708)
    x, y = place - turn.transform(place[None, :])[0]
    found = exactly(far, (x, y, 1.5708))
    assert votes_of(found) == {(4_000_000, 7): (ONE, 0), (3_999_998, 17): (0, ONE)}


def test_a_pose_in_the_plane_turns_space_about_z() -> None:
    grid = map_of({(3, -2, 5): (ONE, 0)})
    assert votes_of(exactly(grid, (SIDE, 0.0, math.pi / 2))) == {(2, 3, 5): (ONE, 0)}


def test_what_the_provenance_says() -> None:
    grid = map_of({(3, -2): (ONE, 0)})
    assert exactly(grid, (0, 0, 0)).provenance == []
    grid.record("a.log", scans=4)
    once = exactly(grid, (1.0, 2.0, 0.0))
    numbers = {"x": 1.0, "y": 2.0, "yaw": 0.0}
    assert once.provenance[0] == {**grid.provenance[0], "moved": [numbers]}
    assert once.provenance[1]["transformed"] == numbers
    twice = exactly(once, (0.0, 0.0, math.pi))
    assert [len(entry.get("moved", ())) for entry in twice.provenance] == [2, 1, 0]
    assert grid.provenance == [{**grid.provenance[0]}]
    assert "moved" not in grid.provenance[0]
    total = map_of({(3, -2): (ONE, 0)}) + once
    assert (total - once).provenance == []


def test_maps_without_evidence_move() -> None:
    assert exactly(EvidenceMap(0.1), (1.0, 0.2, 0.0)).cell_count() == 0
    assert moved(EvidenceMap(0.1), (1.0, 0.2, 0.3)).cell_count() == 0


@pytest.mark.parametrize(
    ("pose", "said"),
    [
        ((math.nan, 0.0, 0.0), "finite pose"),
        (Pose3(np.zeros(3), np.eye(3)), "moved in the plane"),
        ((1.0, 2.0), "a pose is"),
        ((1e300, 0.0, 0.0), r"farther than 2\^46 cells"),
        ((0.1, 0.0, 0.0), r"keeps path lengths.*whole cells \(0.25 m\)"),
        ((0.0, 0.0, 0.7), "keeps path lengths"),
    ],
)
def test_what_cannot_be(pose: Any, said: str) -> None:
    grid = map_of({(3, -2): (ONE, 0), (9, 9): (0, ONE)}, lengths=True)
    with pytest.raises(InputError, match=said):
        grid.transformed(pose)


def test_rotations_that_are_none() -> None:
    with pytest.raises(InputError, match="not orthonormal"):
        map_of({(1, 2, 3): (ONE, 0)}).transformed(Pose3(np.zeros(3), 2.0 * np.eye(3)))
