# SPDX-License-Identifier: Apache-2.0
"""`state` is the same question to all maps: of a region's cells, by thresholds that go by name."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import oddsmap
from oddsmap import EvidenceMap, InputError, MapTooLargeError, State, Thresholds, VoxelMap
from tests.kit import ONE

VOTES = np.array([[3, 0], [0, 3], [0, 5], [1, 1]]) * ONE
STRICT = Thresholds(0.2, 0.99)


def space() -> EvidenceMap:
    grid = EvidenceMap(0.25, ndim=3)
    index = np.array([[0, 0, 0], [-5, 3, 9], [2, 2, 2], [2, 2, 3]])
    grid.add_cells(index, VOTES[:, 0].copy(), VOTES[:, 1].copy())
    return grid


def plane() -> EvidenceMap:
    grid = EvidenceMap(0.25)
    index = np.array([[0, 0], [-5, 3], [2, 2], [3, 2]])
    grid.add_cells(index, VOTES[:, 0].copy(), VOTES[:, 1].copy())
    return grid


@pytest.mark.parametrize("thresholds", [None, STRICT])
def test_voxels_decide_as_the_view_does(thresholds: Thresholds | None) -> None:
    view = space().log_odds()
    voxels = view.to_voxels()
    for region in (None, ((-6, 0, 0), (3, 4, 5)), ((0, 0, 0), (1, 1, 1)), ((7, 7, 7), (7, 8, 9))):
        mine = view.state(region, thresholds=thresholds)
        theirs = voxels.state(region, thresholds=thresholds)
        assert theirs.dtype == mine.dtype == np.int8
        assert np.array_equal(theirs, mine)


def test_large_leaves_fill_their_cells() -> None:
    voxels = VoxelMap(
        np.array([[4, 0, 0], [-1, -5, 1]]), np.array([2.0, -2.0]), 0.5, np.array([2, 0])
    )
    whole = voxels.state()
    lo, hi = voxels.bounds() or (None, None)
    assert lo is not None
    assert hi is not None
    assert whole.shape == tuple((hi - lo)[::-1])
    assert np.count_nonzero(whole == State.OCCUPIED) == 64
    assert np.count_nonzero(whole == State.FREE) == 1
    z, y, x = np.indices(whole.shape).reshape(3, -1)
    assert np.array_equal(voxels.state_at(np.stack([x, y, z], axis=1) + lo), whole.ravel())
    assert voxels.leaf_state().tolist() == [State.FREE, State.OCCUPIED]
    assert (voxels.state(((5, 1, 1), (7, 2, 3))) == State.OCCUPIED).all()
    assert voxels.state(thresholds=Thresholds(0.1, 0.9)).max() == State.UNDECIDED


def test_planes_decide_as_the_view_does() -> None:
    view = plane().log_odds()
    grid = view.to_probability_map()
    for thresholds in (None, STRICT):
        mine = view.state(thresholds=thresholds)
        assert np.array_equal(grid.state(thresholds=thresholds), mine)
    assert (view.state(thresholds=STRICT) == State.OCCUPIED).sum() == 0
    assert (view.state() == State.OCCUPIED).sum() == 1


def test_a_full_map_takes_thresholds_too() -> None:
    scan = oddsmap.Scan(oddsmap.Pose2(0.1, 0.1, 0.0), np.array([[1.0, 0.0]]), np.array([1.0]))
    full = oddsmap.build_full_map([scan], 0.25, sensor=oddsmap.BeamSensor(range_max=3.0))
    p, seen = full.probability(), full.observed()
    for limits in (Thresholds(), Thresholds(0.001, 0.999), Thresholds(0.4, 0.41)):
        assert np.array_equal(full.state(thresholds=limits), limits.state(p, seen))


def test_thresholds_go_by_name_everywhere() -> None:
    for kind in (oddsmap.ProbabilityMap, VoxelMap, oddsmap.LogOdds, oddsmap.FullMap):
        parameters = inspect.signature(kind.state).parameters
        assert parameters["thresholds"].kind is inspect.Parameter.KEYWORD_ONLY
        assert set(parameters) <= {"self", "region", "thresholds"}
    with pytest.raises(InputError, match="thresholds by name"):
        space().log_odds().to_voxels().state(Thresholds())  # type: ignore[arg-type]


def test_boxes_that_are_none() -> None:
    voxels = space().log_odds().to_voxels()
    for region in (((0, 0), (1, 1)), ((0, 0, 0), (1, 1, -1)), (0, 1)):
        with pytest.raises(InputError, match="region"):
            voxels.state(region)
    with pytest.raises(MapTooLargeError, match=r"2048 x 1024 x 1025 cells.*leaf_state"):
        voxels.state(((0, 0, 0), (2048, 1024, 1025)))
    assert VoxelMap(np.zeros((0, 3), np.int64), np.zeros(0), 0.1).state().shape == (0, 0, 0)


def test_indices_of_voxels_are_whole_numbers() -> None:
    voxels = VoxelMap(np.array([[0, 0, 0]]), np.array([1.0]), 0.1)
    with pytest.raises(InputError, match=r"whole numbers, got 0.5 .*region_of\(lo, hi\)"):
        voxels.state(((0.5, 0, 0), (2, 2, 2)))
