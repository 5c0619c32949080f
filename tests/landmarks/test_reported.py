# SPDX-License-Identifier: Apache-2.0
"""The landmarks of a file: a table gives back what was written, JSON too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import LandmarkMap, Pose2
from oddsmap.errors import InputError
from oddsmap.landmarks.landmark import Landmark
from oddsmap.landmarks.observations import Observations
from oddsmap.landmarks.reported import read_landmarks
from oddsmap.landmarks.store import save_csv

number = st.floats(-1e7, 1e7)
HEAD = "id,x,y,cov_xx,cov_xy,cov_yy,count\n"


def same(a: Landmark, b: Landmark) -> bool:
    return (
        (a.id, a.count) == (b.id, b.count)
        and np.array_equal(a.mean, b.mean)
        and np.array_equal(a.covariance, b.covariance)
    )


@given(
    st.sampled_from([2, 3]),
    st.lists(
        st.tuples(st.integers(0, 2**63 - 1), number, st.floats(1e-3, 1e3), st.integers(1, 99)),
        min_size=1,
        max_size=4,
    ),
)
def test_a_table_is_read_as_it_was_written(
    tmp_path_factory: pytest.TempPathFactory,
    ndim: int,
    rows: list[tuple[int, float, float, int]],
) -> None:
    marks = []
    for name, x, sigma, count in rows:
        root = np.tril(np.arange(1, ndim * ndim + 1).reshape(ndim, ndim)) * sigma
        marks.append(Landmark(name, np.full(ndim, x), root @ root.T, count))
    path = tmp_path_factory.mktemp("table") / "trees.csv"
    save_csv(marks, ndim, path)
    assert all(map(same, read_landmarks(path), marks))


def test_both_files_of_a_map(tmp_path: Path) -> None:
    seen = LandmarkMap()
    for x in (0.0, 1.0):
        noise = np.broadcast_to(np.diag([0.01, 0.02]), (2, 2, 2))
        values = np.array([[3.0 - x, 1.0], [5.0 - x, -2.0]])
        ids = np.array([7, 4])
        seen.add(Observations(Pose2(x, 0.0, 0.0), "position", values, noise, ids))
    for name in ("trees.csv", "trees.json"):
        found = read_landmarks(seen.save(tmp_path / name))
        assert [mark.id for mark in found] == [4, 7]
        assert all(map(same, found, seen.landmarks))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("x,y\n0,0\n", r"not a table of landmarks \(id, x, y, cov_xx, \.\.\.\): oddsmap landmarks"),
        ("", "the file is empty"),
        (HEAD + "1,\0,3,1,0,1,2\n", "not a landmark"),
        (HEAD + f"1,{'2' * 200_000},3,1,0,1,2\n", "not a CSV line"),
        (HEAD, "reports no landmark"),
        (HEAD + "1,2,3\n", r"trees\.csv:2: not a landmark \(3 values, the header announces 7"),
        (HEAD + "1,a,3,1,0,1,2\n", r"trees\.csv:2: not a landmark"),
        (HEAD + "1,nan,3,1,0,1,2\n", "a number that is not finite"),
        (HEAD + "1,2,3,1,2,1,2\n", "its covariance has a variance that is not positive"),
        (HEAD + "1.5,2,3,1,0,1,2\n", "not a landmark"),
    ],
)
def test_other_tables_are_refused(tmp_path: Path, content: str, said: str) -> None:
    path = tmp_path / "trees.csv"
    path.write_text(content)
    with pytest.raises(InputError, match=said):
        read_landmarks(path)


def test_a_map_without_a_landmark(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.json: reports no landmark, nothing to show"):
        read_landmarks(LandmarkMap().save(tmp_path / "none.json"))
