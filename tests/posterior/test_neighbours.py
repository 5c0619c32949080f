# SPDX-License-Identifier: Apache-2.0
"""The calibrated view that looks at what lies around a cell."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap
from oddsmap import ConfigError, EvidenceMap, State, load_map
from oddsmap.odds import logit, sigmoid
from oddsmap.posterior.calibrated import Calibrated
from oddsmap.posterior.neighbour_codes import TileCodes, class_count
from oddsmap.posterior.neighbour_model import fit_neighbours, pairs_of_classes
from oddsmap.posterior.neighbour_view import NeighbourView
from oddsmap.simulate import Lidar2D, Lidar3D, drive3d, office_drive, office_plan, town
from tests.kit import ONE, add_votes
from tests.naive import counts as naive_counts
from tests.naive import neighbours as naive


def sparse_office(share: float, seed: int = 3) -> EvidenceMap:
    """A drive through the office, of each scan some beams."""
    rng, plan, lidar = np.random.default_rng(seed), office_plan(), Lidar2D()
    scans = []
    for pose in office_drive(80):
        scan = lidar.scan(plan, pose, rng)
        kept = rng.random(len(scan.ranges)) < share
        scans.append(oddsmap.Scan(pose, scan.directions[kept], scan.ranges[kept]))
    return oddsmap.build_map(scans, 0.1)


@cache
def office() -> EvidenceMap:
    return sparse_office(0.1)


@cache
def streets() -> EvidenceMap:
    rng, world = np.random.default_rng(1), town(1)
    lidar = Lidar3D(ring_count=8, column_count=60, range_max=20.0)
    scans = [
        lidar.scan(world, pose, rng, returns_only=True) for pose in drive3d(8, ground=world.ground)
    ]
    return oddsmap.build_map(scans, 0.5)


@cache
def view_of(make: Callable[[], EvidenceMap]) -> NeighbourView:
    view = make().calibrated(neighbours=True)
    assert isinstance(view, NeighbourView)
    return view


def cells_of(ndim: int) -> st.SearchStrategy[dict[tuple[int, ...], tuple[int, int]]]:
    weight = st.sampled_from([0, 1, ONE, 3 * ONE, 300 * ONE, ONE // 3])
    place = st.integers(-9, 9) if ndim == 2 else st.integers(-3, 4)
    return st.dictionaries(st.tuples(*[place] * ndim), st.tuples(weight, weight), max_size=20)


@pytest.mark.parametrize("ndim", [2, 3])
@given(data=st.data())
@settings(max_examples=15, deadline=None)
def test_classes_are_those_of_sums_over_cells(ndim: int, data: st.DataObject) -> None:
    votes = {cell: w for cell, w in data.draw(cells_of(ndim)).items() if sum(w)}
    grid = EvidenceMap(0.1, ndim=ndim)
    add_votes(grid, votes)
    counts = {cell: (Fraction(h, ONE), Fraction(p, ONE)) for cell, (h, p) in votes.items()}
    places = [*votes, *data.draw(st.lists(st.tuples(*[st.integers(-14, 14)] * ndim), max_size=8))]
    if not places:
        return
    index = np.array(places)
    want = [naive.class_of(counts, cell) for cell in places]
    codes = TileCodes(grid.tiles)
    assert codes.at(index).tolist() == want
    assert codes.at(index[::-1]).tolist() == want[::-1]
    assert max(want) <= class_count(ndim)
    lo, hi = index.min(axis=0), index.max(axis=0) + 1
    if np.prod(hi - lo) < 30_000:
        box = codes.region(lo, hi)
        assert box[tuple((index - lo).T[::-1])].tolist() == want


@pytest.mark.parametrize("ndim", [2, 3])
@given(data=st.data())
@settings(max_examples=15, deadline=None)
def test_pairs_of_each_class_are_those_of_its_cells(ndim: int, data: st.DataObject) -> None:
    votes = {cell: w for cell, w in data.draw(cells_of(ndim)).items() if sum(w)}
    grid = EvidenceMap(0.1, ndim=ndim)
    add_votes(grid, votes)
    counts = {cell: (Fraction(h, ONE), Fraction(p, ONE)) for cell, (h, p) in votes.items()}
    want = Counter((naive.class_of(counts, cell), *w) for cell, w in votes.items())
    found = {
        (code, int(h * ONE), int(p * ONE)): int(n)
        for code, pairs in enumerate(pairs_of_classes(grid), 1)
        for h, p, n in zip(pairs.hits, pairs.passes, pairs.cells, strict=True)
    }
    assert found == {key: n for key, n in want.items() if key[0] > 0}


def test_each_class_is_fitted_to_its_own_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    from oddsmap.posterior import count_fit

    monkeypatch.setattr(count_fit, "_STEPS", 3)
    grid = EvidenceMap(0.1)
    rng = np.random.default_rng(0)
    votes: dict[tuple[int, ...], tuple[int, int]] = {
        (x, y): (int(rng.integers(0, 3)) * ONE, int(rng.integers(1, 5)) * ONE)
        for x, y in itertools.product(range(6), range(4))
    }
    add_votes(grid, votes)
    view = grid.calibrated(neighbours=True)
    counts = {c: (Fraction(h, ONE), Fraction(p, ONE)) for c, (h, p) in votes.items()}
    classes = {cell: naive.class_of(counts, cell) for cell in votes}
    whole = naive_counts.fitted([(h / ONE, p / ONE) for h, p in votes.values()], 3)[0]
    for code in set(classes.values()):
        row = (code - 1) // 4

        def of(chosen: list[int]) -> list[tuple[float, float]]:
            return [(h / ONE, p / ONE) for c, (h, p) in votes.items() if classes[c] in chosen]

        around = naive_counts.fitted(of(list(range(row * 4 + 1, row * 4 + 5))), 3, whole)[0]
        want = naive_counts.fitted(of([code]), 3, around)
        assert isinstance(view, NeighbourView)
        assert np.allclose(view.neighbours.occupancy[code].distributions, want, rtol=1e-9)


@pytest.mark.parametrize("make", [office, streets])
def test_all_ways_to_ask_agree(make: Callable[[], EvidenceMap], tmp_path: Path) -> None:
    grid, view = make(), view_of(make)
    index, log_odds = view.known_log_odds()
    assert np.array_equal(view.log_odds_at(index), log_odds)
    lo, hi = grid.bounds() or (np.zeros(2), np.zeros(2))
    box = view.log_odds((lo - 5, hi + 5))
    assert np.array_equal(box[tuple((index - lo + 5).T[::-1])], log_odds)
    parts = list(view.parts(sigmoid))
    assert np.array_equal(np.concatenate([p for _, p in parts]), sigmoid(log_odds))
    alpha, beta = view.reflectivity.parameters((lo - 5, hi + 5))
    known = view.reflectivity.cells()
    assert np.array_equal(alpha[tuple((known[0] - lo + 5).T[::-1])], known[1])
    with_map = grid.calibrated(
        neighbours=view.neighbours,
        prior=oddsmap.PriorArray(np.full((1,) * grid.ndim, 0.9), index[0]),
    )
    assert with_map.log_odds_at(index[:1])[0] == pytest.approx(
        log_odds[0] + float(logit(0.9)) - float(logit(view.prior))
    )
    view.save_npz(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as rows:
        seen, where = rows["observed"], rows["index"]
        assert np.array_equal(where[seen], index)
        # Every cell whose neighbours tell something of it is there, and once.
        told = box != float(logit(view.prior))
        assert len(np.unique(where, axis=0)) == len(where) >= told.sum()
        p = sigmoid(box[tuple((where - lo + 5).T[::-1])])
        assert np.allclose(rows["probability"], p, atol=1e-6)
        at = tuple((where - lo + 5).T[::-1])
        assert np.allclose(rows["reflectivity"], (alpha / (alpha + beta))[at], atol=1e-6)
        assert not rows["hits"][~seen].any()
        assert (rows["reflectivity_low"] <= rows["reflectivity"] + 1e-6).all()


def test_unseen_cells_are_told_and_stay_unknown() -> None:
    grid = office()
    view = view_of(office)
    box = (np.array([0, 0]), np.array([200, 140]))
    unseen = ~view.observed(box)
    assert np.array_equal(unseen, ~grid.calibrated().observed(box))
    assert (view.state(box)[unseen] == State.UNKNOWN).all()
    p = view.probability(box)[unseen]
    assert len(np.unique(p)) > 10
    assert view.log_odds_at([[9999, 9999]])[0] == float(logit(view.prior))
    found = view.states_at([[-50.0, -50.0]])
    assert found.state.tolist() == [State.UNKNOWN]


def test_a_sparse_map_predicts_held_out_beams_better() -> None:
    other = sparse_office(1.0, seed=4)
    index, hits, passes = other.cells()
    known = office().log_odds().observed_at(index)
    plain, ours = office().calibrated(), view_of(office)

    def log_loss(view: Calibrated, chosen: np.ndarray) -> float:
        alpha, beta, _ = view.reflectivity.parameters_at(index[chosen])
        p, n = alpha / (alpha + beta), (hits + passes)[chosen].sum()
        return float(-(hits[chosen] * np.log(p) + passes[chosen] * np.log1p(-p)).sum() / n)

    assert log_loss(ours, known) < 0.9 * log_loss(plain, known)
    assert log_loss(ours, ~known) < 0.8 * log_loss(plain, ~known)
    truth = office_plan().rasterise(0.1, (0, 0), (200, 140), samples=5)
    seen = plain.observed((np.array([0, 0]), np.array([200, 140])))
    box = (np.array([0, 0]), np.array([200, 140]))
    scores = [oddsmap.evaluate(v.probability(box), truth, seen).log_loss for v in (ours, plain)]
    assert scores[0] < 0.8 * scores[1]


def test_merged_saved_and_loaded_maps_have_the_same_bits(tmp_path: Path) -> None:
    grid, view = office(), view_of(office)
    grid.save(tmp_path / "a.zarr")
    bounds = grid.bounds()
    assert bounds is not None
    half = bounds[0] + (60, 0)
    other = EvidenceMap(0.1) + load_map(tmp_path / "a.zarr")
    again = other.calibrated(neighbours=True)
    assert isinstance(again, NeighbourView)
    assert again.neighbours == view.neighbours
    assert np.array_equal(again.probability(), view.probability())
    part = grid.crop(*(x.tolist() for x in (half, half + 40)))
    kept = part.calibrated(neighbours=view.neighbours)
    inner = (half + 4, half + 36)
    assert np.array_equal(kept.probability(inner), view.probability(inner))
    with pytest.raises(ConfigError, match="leave out model"):
        grid.calibrated(neighbours=True, model=view.model)


def test_added_evidence_shows_around_it() -> None:
    grid = EvidenceMap(0.1)
    add_votes(grid, {(x, 0): (0, ONE) for x in range(20)})
    view = grid.calibrated(neighbours=view_of(office).neighbours)
    before = view.log_odds_at([[5, 6]])
    add_votes(grid, {(5, 5): (3 * ONE, 0)})
    assert view.log_odds_at([[5, 6]])[0] > before[0] + 0.1


def test_an_empty_map_has_its_prior() -> None:
    view = EvidenceMap(0.1, ndim=3).calibrated(neighbours=True)
    assert view.bounds() is None
    assert float(view.at([[0.0, 0.0, 0.0]])[0]) == pytest.approx(view.prior)
    empty = EvidenceMap(0.1)
    model = empty.calibrated().model
    assert set(fit_neighbours(empty, model, (0.1, 1.0)).occupancy) == {model}
