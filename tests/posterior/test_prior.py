# SPDX-License-Identifier: Apache-2.0
"""Prior maps of every kind: what they give each cell, and that evidence adds to it alone."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import (
    BeamSensor,
    EvidenceMap,
    LogOdds,
    ProbabilityMap,
    State,
    VoxelMap,
    build_map,
    load_octomap,
    load_ros,
)
from oddsmap.config.config import PosteriorConfig
from oddsmap.errors import ConfigError, InputError
from oddsmap.odds import logit, sigmoid
from oddsmap.posterior.prior import PRIOR_LIMIT, PriorArray, PriorMap
from tests.kit import ONE, Votes, add_votes, random_scans

probability = st.floats(0.001, 0.999)
above, below = st.floats(0.501, 0.999), st.floats(0.001, 0.499)


def some_map(seed: int, ndim: int = 2, resolution: float = 0.5, cells: int = 60) -> EvidenceMap:
    """Votes of 0 to 5 in cells around the origin, some with none at all."""
    rng = np.random.default_rng(seed)
    index = np.unique(rng.integers(-12, 12, (cells, ndim)), axis=0)
    evidence = EvidenceMap(resolution, ndim=ndim, posterior=PosteriorConfig(prior=0.3))
    evidence.add_cells(index, *(rng.integers(0, 6, (2, len(index))) * ONE // 2))
    return evidence


def some_grid(seed: int, **place: float) -> ProbabilityMap:
    rng = np.random.default_rng(seed)
    return ProbabilityMap(
        rng.uniform(0.0, 1.0, (9, 14)), rng.random((9, 14)) < 0.8,
        place.get("resolution", 0.5), (place.get("x", -2.0), place.get("y", 1.5)),
        place.get("yaw", 0.0),
    )  # fmt: skip


def looked_up(grid: ProbabilityMap, x: float, y: float, uniform: float) -> float:
    """The slow way: one cell, by the definition of a ROS map's origin; NaN beside a border."""
    dx, dy = x - grid.origin[0], y - grid.origin[1]
    u = math.cos(grid.yaw) * dx + math.sin(grid.yaw) * dy
    v = -math.sin(grid.yaw) * dx + math.cos(grid.yaw) * dy
    u, v = u / grid.resolution, v / grid.resolution
    if min(abs(u - round(u)), abs(v - round(v))) < 2e-6:
        return math.nan
    column, row = math.floor(u), math.floor(v)
    ny, nx = grid.probability.shape
    if not (0 <= row < ny and 0 <= column < nx and grid.observed[row, column]):
        return uniform
    return min(max(float(grid.probability[row, column]), PRIOR_LIMIT), 1 - PRIOR_LIMIT)


def box(lo: npt.ArrayLike, hi: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Cells of a region in the order of its flattened array."""
    spans = [np.arange(a, b) for a, b in zip(np.asarray(lo), np.asarray(hi), strict=True)]
    return np.stack([axis.ravel() for axis in np.meshgrid(*spans[::-1], indexing="ij")][::-1], 1)


class TestGrid:
    @given(
        st.integers(0, 99),
        st.sampled_from([0.5, 0.25, 0.37, 1.3]),
        st.sampled_from([0.0, 0.4, -2.0]),
        st.floats(-3, 3),
    )
    def test_cells_are_looked_up_at_their_centres(
        self, seed: int, resolution: float, yaw: float, x: float
    ) -> None:
        x, y = x + math.sqrt(2) / 100, math.sqrt(3)  # centres on borders by chance alone
        grid = some_grid(seed, resolution=resolution, yaw=yaw, x=x, y=y)
        evidence = some_map(seed)
        prior = PriorMap(grid, evidence, 0.3)
        index = box((-10, -10), (20, 20))
        want = [looked_up(grid, x, y, 0.3) for x, y in ((index + 0.5) * 0.5).tolist()]
        sure = ~np.isnan(want)
        assert np.count_nonzero(~sure) < 100
        assert np.allclose(sigmoid(prior.at(index))[sure], np.array(want)[sure], rtol=1e-9)

    def test_the_same_grid_is_the_same_cells(self) -> None:
        for r in (0.05, 0.1, 0.3):
            p = np.linspace(0.01, 0.99, 12).reshape(3, 4)
            grid = ProbabilityMap(p, np.ones(p.shape, bool), r, (-700 * r, 999 * r))
            prior = PriorMap(grid, EvidenceMap(r), 0.5)
            assert np.array_equal(prior.region((-700, 999), (-696, 1002)), logit(p))

    def test_far_from_the_origin(self) -> None:
        p = np.linspace(0.01, 0.99, 12).reshape(3, 4)
        r, first = 0.05, np.array([500_000 * 20, 5_400_000 * 20])  # UTM
        grid = ProbabilityMap(p, np.ones(p.shape, bool), r, (first[0] * r, first[1] * r))
        prior = PriorMap(grid, EvidenceMap(r), 0.5)
        assert np.array_equal(prior.region(first, first + np.array([4, 3])), logit(p))

    def test_certainty_is_clipped(self) -> None:
        grid = ProbabilityMap(np.array([[0.0, 1.0, 0.4]]), np.array([[True, True, False]]), 1.0)
        evidence = EvidenceMap(1.0)
        add_votes(evidence, {(0, 0): (60 * ONE, 0), (1, 0): (0, 60 * ONE)})
        view = evidence.log_odds(prior=grid)
        p = sigmoid(view.prior_at([[0, 0], [1, 0], [2, 0], [9, 9]]))
        assert np.allclose(p, [1e-6, 1 - 1e-6, 0.5, 0.5], rtol=1e-9, atol=0)
        assert view.probability(((0, 0), (2, 1))).tolist() == [
            [pytest.approx(1.0), pytest.approx(0.0, abs=1e-4)]
        ]

    def test_a_ros_map(self, tmp_path: Path) -> None:
        old = some_map(3).log_odds()
        old.save_ros(tmp_path / "old.yaml", mode="scale")
        evidence = some_map(4)
        view = evidence.log_odds(prior=load_ros(tmp_path / "old.yaml"))
        seen = old.observed()
        want = np.where(seen, old.probability(), 0.3)
        got = sigmoid(view.prior_map.region(*old.evidence.bounds()))  # type: ignore[union-attr, misc]
        assert np.allclose(got, want, atol=0.01)  # 8 bits, fewer between the thresholds
        assert np.count_nonzero(seen) > 20


class TestViews:
    @pytest.mark.parametrize("ndim", [2, 3])
    def test_an_old_map_and_a_new_one_are_one(self, ndim: int) -> None:
        """Prior, old evidence, new evidence: as if all had gone into one map."""
        old, new = some_map(1, ndim), some_map(2, ndim)
        both = new.like()
        both.merge(old)
        both.merge(new)
        for prior in (old, old.log_odds(), old.log_odds(prior=0.3)):
            view = new.log_odds(prior=prior)
            region = ([-14] * ndim, [14] * ndim)
            assert np.allclose(view.log_odds(region), both.log_odds().log_odds(region), atol=1e-12)
            index, p = view.cells()
            assert np.allclose(p, sigmoid(both.log_odds().log_odds_at(index)), atol=1e-12)

    def test_priors_of_priors(self) -> None:
        grid = some_grid(5)
        old, new = some_map(1), some_map(2)
        both = new.like()
        both.merge(old)
        both.merge(new)
        region = ((-20, -20), (20, 20))
        chained = new.log_odds(prior=old.log_odds(prior=grid))
        assert np.allclose(
            chained.log_odds(region), both.log_odds(prior=grid).log_odds(region), atol=1e-12
        )

    def test_a_bare_map_brings_its_model_but_no_prior(self) -> None:
        old = EvidenceMap(1.0, sensor=BeamSensor(p_hit=0.9), posterior=PosteriorConfig(prior=0.01))
        add_votes(old, {(0, 0): (ONE, 0)})
        new = EvidenceMap(1.0, posterior=PosteriorConfig(prior=0.2))
        p = new.log_odds(prior=old).probability(((0, 0), (2, 1)))
        assert np.allclose(p, [[float(sigmoid(logit(0.2) + logit(0.9))), 0.2]])
        of_view = new.log_odds(prior=old.log_odds()).probability(((0, 0), (2, 1)))
        assert np.allclose(of_view, [[float(sigmoid(logit(0.01) + logit(0.9))), 0.01]])

    @pytest.mark.parametrize(("mine", "theirs"), [(0.5, 0.25), (0.5, 1.0), (0.5, 0.3)])
    def test_other_resolutions(self, mine: float, theirs: float) -> None:
        old, new = some_map(1, resolution=theirs).log_odds(), EvidenceMap(mine)
        lo, hi = np.array([-6, -6]), np.array([6, 6])
        got = new.log_odds(prior=old).log_odds((lo, hi)).ravel()
        for cell, value in zip(box(lo, hi), got, strict=True):
            place = np.floor((cell + 0.5) * mine / theirs + 1e-9).astype(int)
            assert value == old.log_odds((place, place + 1)).item()

    def test_region_and_cells_are_looked_up_alike(self) -> None:
        old, new = some_map(1), some_map(2)
        prior = PriorMap(old.log_odds(), new, 0.5)
        lo, hi = (-15, -13), (14, 13)
        assert np.array_equal(prior.region(lo, hi).ravel(), prior.at(box(lo, hi)))

    def test_it_follows_its_source_and_may_be_clamped(self) -> None:
        old, new = EvidenceMap(1.0), EvidenceMap(1.0)
        view = new.log_odds(prior=old.log_odds(clamp=(0.1, 0.9)))
        cell = ((0, 0), (1, 1))
        assert view.probability(cell).item() == 0.5
        add_votes(old, {(0, 0): (100 * ONE, 0)})
        assert view.probability(cell).item() == pytest.approx(0.9)


class TestSpace:
    def test_leaves_of_any_size(self, tmp_path: Path) -> None:
        voxels = VoxelMap(
            np.array([[0, 0, 0], [4, 0, 0]]), np.array([2.0, -1.0]), 0.25,
            np.array([2, 0], np.uint8),
        )  # fmt: skip
        evidence = EvidenceMap(0.25, ndim=3, posterior=PosteriorConfig(prior=0.2))
        evidence.add_cells(np.array([[4, 0, 0]]), np.array([ONE]), np.array([0]))
        row = evidence.log_odds(prior=voxels).log_odds(((-1, 3, 3), (6, 4, 4)))[0, 0]
        out = float(logit(0.2))
        assert row.tolist() == [out, 2.0, 2.0, 2.0, 2.0, out, out]
        row = evidence.log_odds(prior=voxels).log_odds(((3, 0, 0), (6, 1, 1)))[0, 0]
        assert row.tolist() == [2.0, -1.0 + float(logit(0.7)), out]
        # Twice as coarse: centres on borders belong to the upper cell, index 2 i + 1.
        coarse = EvidenceMap(0.5, ndim=3).log_odds(prior=voxels)
        assert coarse.log_odds(((0, 0, 0), (3, 1, 1)))[0, 0].tolist() == [2.0, 2.0, 0.0]
        voxels.save_octomap(tmp_path / "old.ot")
        again = evidence.log_odds(prior=load_octomap(tmp_path / "old.ot"))
        assert again.log_odds(((0, 0, 0), (1, 1, 1))).item() == 2.0

    def test_to_voxels(self) -> None:
        old, new = some_map(1, 3), some_map(2, 3)
        voxels = new.log_odds(prior=old).to_voxels()
        both = new.like()
        both.merge(old)
        both.merge(new)
        index = voxels.index
        assert len(index) == new.cell_count()
        assert np.allclose(voxels.log_odds, both.log_odds().log_odds_at(index), atol=1e-12)


class TestArray:
    def test_cells(self) -> None:
        array = PriorArray(np.array([[0.1, 0.2, np.nan], [0.0, 0.5, 1.0]]), (-1, 4))
        evidence = EvidenceMap(0.1, posterior=PosteriorConfig(prior=0.3))
        got = evidence.log_odds(prior=array).probability(((-2, 4), (3, 6)))
        want = [[0.3, 0.1, 0.2, 0.3, 0.3], [0.3, 1e-6, 0.5, 1 - 1e-6, 0.3]]
        assert np.allclose(got, want, rtol=1e-9, atol=0)
        cube = PriorArray(np.arange(24).reshape(4, 3, 2) / 24, (5, 6, 7))
        space = EvidenceMap(0.1, ndim=3).log_odds(prior=cube)
        got = space.probability(((5, 6, 7), (7, 9, 11)))
        assert np.allclose(got, np.maximum(cube.probability, 1e-6))

    @pytest.mark.parametrize(
        ("array", "first"), [(np.zeros((2, 2)), (0, 0, 0)), (np.zeros(3), (0,)), ([[2.0]], (0, 0))]
    )
    def test_bad_arrays(self, array: npt.NDArray[np.float64], first: tuple[int, ...]) -> None:
        with pytest.raises(InputError, match="a prior"):
            PriorArray(array, first)


@given(st.text("hp-", max_size=40), above, below, st.lists(probability, min_size=4, max_size=4))
def test_the_recursion_equals_the_closed_form_with_a_prior_of_each_cell(
    readings: str, p_hit: float, p_miss: float, priors: list[float]
) -> None:
    """Table 9.1 with l_0 of the cell, in the order given and reversed; cell 3 is never read."""
    sensor = BeamSensor(p_hit=p_hit, p_miss=p_miss, hit_width=0.5)
    where = {"h": 3.0, "p": 1.0, "-": 9.0}  # around, before and behind a return at 3 m
    evidence = EvidenceMap(1.0)
    order = readings
    want = []
    for cell, prior in enumerate(priors[:3]):
        start = math.log(prior / (1 - prior))
        log_odds = start
        for reading in order:
            p = float(sensor.inverse_model(where[reading], 3.0, prior))
            log_odds += math.log(p / (1 - p)) - start
        want.append(log_odds)
        order = order[::-1]
        votes: Votes = {(cell, 0): (readings.count("h") * ONE, readings.count("p") * ONE)}
        add_votes(evidence, votes)
    view = evidence.log_odds(p_hit=p_hit, p_miss=p_miss, prior=PriorArray([priors], (0, 0)))  # type: ignore[arg-type]
    got = view.log_odds(((0, 0), (4, 1)))[0]
    assert np.allclose(got[:3], want, rtol=1e-9, atol=1e-9)
    assert got[3] == logit(priors[3])  # to the bit


@given(st.integers(0, 999), above, below)
def test_no_evidence_no_increment_to_the_bit(seed: int, p_hit: float, p_miss: float) -> None:
    evidence = some_map(seed)
    sources = (some_grid(seed), some_map(seed + 1), some_map(seed + 2, resolution=0.3).log_odds())
    for source in sources:
        view = evidence.log_odds(p_hit=p_hit, p_miss=p_miss, prior=source)
        assert view.prior_map is not None
        region = ((-20, -20), (20, 20))
        prior, unseen = view.prior_map.region(*region), ~view.observed(region)
        assert unseen.any()
        assert np.array_equal(view.log_odds(region)[unseen], prior[unseen])
        assert (view.state(region)[unseen] == State.UNKNOWN).all()
        assert np.array_equal(view.observed(region), evidence.log_odds().observed(region))


def test_a_million_updates_on_a_prior_map() -> None:
    """Recursive addition drifts; integer counts do not."""
    prior = PriorArray(np.array([[0.2, 0.9]]), (0, 0))
    evidence, steps = EvidenceMap(1.0), 10**6
    rng = np.random.default_rng(0)
    hits = rng.random(steps) < 0.4
    for part in np.array_split(hits, 50):
        add_votes(evidence, {(0, 0): (int(part.sum()) * ONE, int((~part).sum()) * ONE)})
    n = int(hits.sum())
    want = math.log(0.2 / 0.8) + (n * math.log(7 / 3) + (steps - n) * math.log(2 / 3))
    got = evidence.log_odds(prior=prior).log_odds(((0, 0), (2, 1)))[0]
    assert math.isclose(got[0], want, rel_tol=1e-13)
    assert got[1] == logit(0.9)


def test_every_output_has_the_prior(tmp_path: Path) -> None:
    evidence, grid = some_map(7), some_grid(8)
    view = evidence.log_odds(prior=grid)
    region = evidence.bounds()
    assert region is not None
    want = sigmoid(view.log_odds_at(box(*region))).reshape(view.probability().shape)
    assert not np.allclose(want, evidence.log_odds().probability())
    assert np.array_equal(view.probability(), want)
    assert np.array_equal(view.to_probability_map().probability, want)
    assert np.array_equal(view.state(), view.thresholds.state(want, view.observed()))
    index, p = view.cells()
    assert np.array_equal(p, sigmoid(view.log_odds_at(index)))
    view.save_npz(tmp_path / "m.npz")
    with np.load(tmp_path / "m.npz") as arrays:
        assert np.array_equal(arrays["probability"], p.astype(np.float32))
    pytest.importorskip("xarray")
    array = view.to_xarray()
    assert np.array_equal(array.values, want)
    assert array.attrs["prior"] == "map"


def test_a_real_build_on_a_prior() -> None:
    scans = random_scans(4, 10)
    first, second = build_map(scans[:5], 0.25), build_map(scans[5:], 0.25)
    whole = build_map(scans, 0.25).log_odds()
    got = second.log_odds(prior=first.log_odds())
    region = whole.evidence.bounds()
    assert region is not None
    assert np.allclose(got.log_odds(region), whole.log_odds(region), atol=1e-12)


class TestClamp:
    def test_bounds_of_the_view(self) -> None:
        evidence = some_map(3)
        free, bound = evidence.log_odds(), evidence.log_odds(clamp=(0.2, 0.6))
        want = np.clip(free.log_odds(), logit(0.2), logit(0.6))
        assert np.array_equal(bound.log_odds(), want)
        assert np.allclose(bound.cells()[1], np.clip(free.cells()[1], 0.2, 0.6))
        assert free.probability().max() > 0.61
        assert np.array_equal(evidence.log_odds().log_odds(), free.log_odds())  # the view alone

    def test_not_the_filter_that_clamps_each_update(self) -> None:
        evidence = EvidenceMap(1.0)
        add_votes(evidence, {(0, 0): (10 * ONE, 10 * ONE)})
        view = evidence.log_odds(p_hit=0.7, p_miss=0.3, clamp=(0.12, 0.97))
        assert view.probability().item() == pytest.approx(0.5)
        log_odds = 0.0
        for step in [logit(0.7)] * 10 + [logit(0.3)] * 10:
            log_odds = float(np.clip(log_odds + step, logit(0.12), logit(0.97)))
        assert sigmoid(log_odds) < 0.2

    @pytest.mark.parametrize("clamp", [(0.0, 0.9), (0.1, 1.0), (0.9, 0.1), (0.5, math.nan)])
    def test_bad_bounds(self, clamp: tuple[float, float]) -> None:
        with pytest.raises(ConfigError, match="clamp needs"):
            EvidenceMap(1.0).log_odds(clamp=clamp)


class TestErrors:
    def test_dimensions(self) -> None:
        plane, space = EvidenceMap(1.0), EvidenceMap(1.0, ndim=3)
        voxels = VoxelMap(np.zeros((1, 3), int), np.zeros(1), 1.0)
        for source in (space, space.log_odds(), voxels, PriorArray(np.zeros((1, 1, 1)), (0, 0, 0))):
            with pytest.raises(InputError, match="prior is a 3D map, this map is 2D"):
                plane.log_odds(prior=source)
        for other in (plane, some_grid(1), PriorArray(np.zeros((1, 1)), (0, 0))):
            with pytest.raises(InputError, match="prior is a 2D map, this map is 3D"):
                space.log_odds(prior=other)

    def test_itself(self) -> None:
        evidence = some_map(1)
        for source in (evidence, evidence.log_odds()):
            with pytest.raises(InputError, match="count twice"):
                LogOdds(evidence, prior=source)

    def test_no_map(self) -> None:
        with pytest.raises(InputError, match="a PriorArray, got list"):
            EvidenceMap(1.0).log_odds(prior=[0.5])  # type: ignore[arg-type]

    def test_no_probabilities(self) -> None:
        grid = ProbabilityMap(np.array([[1.5, 7.0]]), np.array([[True, False]]), 1.0)
        with pytest.raises(InputError, match="1 values are not"):
            EvidenceMap(1.0).log_odds(prior=grid)
