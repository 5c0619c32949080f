# SPDX-License-Identifier: Apache-2.0
"""What views hand to files and pictures: their own thresholds, and the place of their cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import (
    EvidenceMap,
    LogOdds,
    ProbabilityMap,
    State,
    Thresholds,
    changed,
    load_octomap,
    load_ros,
)
from tests.kit import ONE

# p of 0.84, 0.7, 0.4 and 0.31 by the default model.
HITS, PASSES = np.array([2, 1, 0, 0]), np.array([0, 0, 1, 2])
FIRST = (-8, 3)


def small_map(ndim: int, **settings: Any) -> EvidenceMap:
    evidence = EvidenceMap(0.5, ndim=ndim, **settings)
    places = np.zeros((4, ndim), np.int64)
    places[:, :2] = np.array([[0, 0], [1, 0], [2, 1], [3, 1]]) + FIRST
    evidence.add_cells(places, ONE * HITS, ONE * PASSES)
    if evidence.lengths is not None:
        evidence.lengths.add_cells(places, ONE * np.stack([0 * HITS, 1 + PASSES], axis=1))
    return evidence


def view(ndim: int, limits: Thresholds | None = None, **settings: Any) -> LogOdds:
    return LogOdds(small_map(ndim, **settings), thresholds=limits)


# Between 0.4 and 0.31, and between 0.7 and 0.84: the outer two alone are decided.
STRICT = Thresholds(0.35, 0.75)
OCCUPIED_BY = {None: 2, STRICT: 1}


@pytest.mark.parametrize("limits", OCCUPIED_BY)
def test_a_ros_map_is_written_by_the_thresholds_of_the_view(
    limits: Thresholds | None, tmp_path: Path
) -> None:
    there = view(2, limits)
    path, _ = there.save_ros(tmp_path / "m.yaml")
    state = load_ros(path).state(thresholds=limits)
    want = there.state()
    assert np.count_nonzero(want == State.OCCUPIED) == OCCUPIED_BY[limits]
    for decided in (State.OCCUPIED, State.FREE):
        assert np.array_equal(state == decided, want == decided)


@pytest.mark.parametrize("limits", OCCUPIED_BY)
def test_points_and_voxels_are_written_by_the_thresholds_of_the_view(
    limits: Thresholds | None, tmp_path: Path
) -> None:
    there = view(3, limits)
    there.save_ply(tmp_path / "m.ply")
    header = (tmp_path / "m.ply").read_bytes().split(b"end_header")[0].decode()
    assert f"element vertex {OCCUPIED_BY[limits]}\n" in header
    # What is undecided is occupied from one half on, whatever the thresholds.
    generous = view(3, limits and Thresholds(0.35, 0.39))
    generous.save_octomap(tmp_path / "m.bt")
    occupied = np.count_nonzero(load_octomap(tmp_path / "m.bt").log_odds > 0)
    assert occupied == (2 if limits is None else 3)


def test_cells_keep_their_place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """x before y, in metres: no two axes are alike here."""
    evidence = small_map(2, votes="beam", path_lengths=True)
    there = LogOdds(evidence)
    drawn: list[ProbabilityMap] = []
    monkeypatch.setattr(
        "oddsmap.plot.quantity.save_quantity", lambda grid, *_, **__: drawn.append(grid)
    )
    evidence.reflection().save_png(tmp_path / "r.png")
    evidence.decay_rate().save_png(tmp_path / "d.png")
    grids = [
        there.to_probability_map(),
        evidence.reflection().to_probability_map(),
        changed(there, view(2)).to_probability_map(),
        *drawn,
    ]
    assert len(grids) == 5
    for grid in grids:
        assert grid.origin == (FIRST[0] * 0.5, FIRST[1] * 0.5)
        assert grid.resolution == 0.5
        assert grid.observed.tolist() == [[True, True, False, False], [False, False, True, True]]


def test_arrays_have_the_votes_of_their_cells(tmp_path: Path) -> None:
    evidence = small_map(2, votes="beam", path_lengths=True)
    for name, posterior in (
        ("log_odds", evidence.log_odds()),
        ("reflection", evidence.reflection()),
        ("decay", evidence.decay_rate()),
    ):
        posterior.save_npz(tmp_path / f"{name}.npz")
        with np.load(tmp_path / f"{name}.npz") as arrays:
            assert arrays["hits"].tolist() == HITS.tolist()
            assert arrays["passes"].tolist() == PASSES.tolist()
            assert arrays["observed"].all()
            if name == "decay":
                assert arrays["length"].tolist() == (0.5 * (1 + PASSES)).tolist()


def test_an_interval_that_ends_at_the_threshold_decides_nothing() -> None:
    """Occupied is what lies above it as a whole, free what lies below."""
    reflection = small_map(2, votes="beam").reflection()
    box = (FIRST, np.add(FIRST, (1, 1)))
    lower, upper = (float(end.item()) for end in reflection.interval(box))
    for threshold, state in (
        (np.nextafter(lower, 0.0), State.OCCUPIED),
        (lower, State.UNDECIDED),
        (upper, State.UNDECIDED),
        (np.nextafter(upper, 1.0), State.FREE),
    ):
        reflection.threshold = float(threshold)
        assert reflection.state(box).tolist() == [[state]]
