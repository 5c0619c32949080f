"""3D maps without counts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oddsmap
from oddsmap import InputError, MapTooLargeError, State, VoxelMap
from oddsmap.map_files.morton import morton, unmorton

places = st.integers(0, (1 << 21) - 1)


@given(st.lists(st.tuples(places, places, places), min_size=1, max_size=20))
def test_morton_codes_interleave_bits(cells: list[tuple[int, int, int]]) -> None:
    index = np.array(cells)
    slow = [
        sum((cell[axis] >> bit & 1) << (3 * bit + axis) for bit in range(21) for axis in range(3))
        for cell in cells
    ]
    assert morton(index).tolist() == slow
    assert np.array_equal(unmorton(morton(index)), index)


@pytest.mark.parametrize("shift", [0, -(10**5), 10**9])
def test_leaves_of_two_sizes(shift: int) -> None:
    # Far from the origin as near it: a shift by a multiple of the largest leaf.
    shift -= shift % 4
    index = np.array([[4, 0, 0], [0, -4, 8], [-1, -5, 1]]) + shift
    voxels = VoxelMap(index, np.array([2.0, -2.0, 0.2]), 0.5, np.array([2, 1, 0]))
    assert (voxels.leaf_count, voxels.cell_count) == (3, 64 + 8 + 1)
    bounds = voxels.bounds()
    assert bounds is not None
    lo, hi = bounds
    assert np.array_equal(lo, np.array([-1, -5, 0]) + shift)
    assert np.array_equal(hi, np.array([8, 4, 10]) + shift)
    around = np.stack(np.meshgrid(*[np.arange(-6, 12)] * 3), axis=-1).reshape(-1, 3)
    expected = np.full(len(around), int(State.UNKNOWN))
    for corner, side, state in (
        ((4, 0, 0), 4, State.OCCUPIED),
        ((0, -4, 8), 2, State.FREE),
        ((-1, -5, 1), 1, State.UNDECIDED),
    ):
        inside = ((around >= corner) & (around < np.add(corner, side))).all(axis=1)
        expected[inside] = state
    assert np.array_equal(voxels.state_at(around + shift), expected)
    listed, p = voxels.cells()
    assert len(np.unique(listed, axis=0)) == len(listed) == 73
    assert np.array_equal(voxels.find(listed) >= 0, np.ones(73, np.bool_))
    assert np.array_equal(p, voxels.probability[voxels.find(listed)])
    part, _ = voxels.cells((np.array([5, 1, 2]) + shift, np.array([7, 9, 3]) + shift))
    assert sorted(map(tuple, (part - shift).tolist())) == [
        (x, y, 2) for x in (5, 6) for y in (1, 2, 3)
    ]


def test_too_many_cells_to_list() -> None:
    voxels = VoxelMap(np.zeros((1, 3), np.int64), np.zeros(1), 0.1, np.array([4]))
    with pytest.raises(MapTooLargeError, match=r"1 leaves cover 4096 cells.*max_cells"):
        voxels.cells(max_cells=4095)
    assert len(voxels.cells(max_cells=4096)[0]) == 4096


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"index": np.zeros((2, 2), np.int64)}, r"shape \(n, 3\)"),
        ({"log_odds": np.zeros(3)}, "2 leaves need"),
        ({"log_odds": np.array([0.0, np.nan])}, "1 log odds are not finite"),
        ({"resolution": 0.0}, "positive resolution"),
        ({"level": np.array([0, 16])}, "levels of leaves"),
        ({"level": np.array([0, 1])}, "multiple of 2"),
        ({"index": np.array([[1, 1, 1], [1, 1, 1]])}, "overlap"),
        ({"index": np.array([[0, 0, 0], [1, 1, 1]]), "level": np.array([1, 0])}, "overlap"),
    ],
)
def test_senseless_arguments(change: dict[str, Any], message: str) -> None:
    fine: dict[str, Any] = {
        "index": np.array([[0, 0, 0], [1, 1, 1]]),
        "log_odds": np.zeros(2),
        "resolution": 0.1,
    }
    VoxelMap(**fine)
    with pytest.raises(InputError, match=message):
        VoxelMap(**{**fine, **change})


def test_too_wide() -> None:
    wide = np.array([[0, 0, 0], [1 << 21, 0, 0]])
    with pytest.raises(MapTooLargeError, match="2097152 cells along an axis"):
        VoxelMap(wide, np.zeros(2), 0.1)
    assert VoxelMap(wide - [[0, 0, 0], [1, 0, 0]], np.zeros(2), 0.1).leaf_count == 2


def test_a_view_of_space() -> None:
    grid = oddsmap.EvidenceMap(0.25, ndim=3)
    index = np.array([[0, 0, 0], [-5, 3, 9], [2, 2, 2]])
    grid.add_cells(index, np.array([3, 0, 1]) * 65536, np.array([0, 3, 1]) * 65536)
    view = grid.log_odds()
    lo, hi = grid.bounds() or (None, None)
    assert lo is not None
    assert hi is not None
    state = view.state()
    assert state.shape == tuple((hi - lo)[::-1])
    voxels = view.to_voxels()
    z, y, x = np.indices(state.shape).reshape(3, -1)
    everywhere = np.stack([x, y, z], axis=1) + lo
    assert np.array_equal(voxels.state_at(everywhere, thresholds=view.thresholds), state.ravel())
    assert np.count_nonzero(state != State.UNKNOWN) == 3
    leaf = voxels.find(index)
    assert np.array_equal(voxels.log_odds[leaf], view.of_votes([3, 0, 1], [0, 3, 1]))
    with pytest.raises(InputError, match="2D"):
        oddsmap.EvidenceMap(0.25).log_odds().to_voxels()
    with pytest.raises(InputError, match=r"oddsmap\.project"):
        view.to_probability_map()


def test_npz_of_space(tmp_path: Any) -> None:
    grid = oddsmap.EvidenceMap(0.25, ndim=3)
    grid.add_cells(np.array([[1, -2, 3]]), np.array([65536]), np.array([0]))
    grid.log_odds().save_npz(tmp_path / "space.npz")
    with np.load(tmp_path / "space.npz") as arrays:
        assert arrays["index"].tolist() == [[1, -2, 3]]
        assert arrays["hits"].tolist() == [1.0]
