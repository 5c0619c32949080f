# SPDX-License-Identifier: Apache-2.0
"""Maps beyond the keys of an OctoMap, and the shift that brings them inside."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import ConfigError, EvidenceMap, InputError, VoxelMap, load_octomap
from oddsmap.map_files.octomap_range import HALF, check_keys, shift_of

ONE = 65536


def utm_map(resolution: float = 0.2) -> EvidenceMap:
    grid = EvidenceMap(resolution, ndim=3)
    first = np.rint(np.array([500_000, 5_400_000, 120]) / resolution).astype(np.int64)
    index = np.array([[0, 0, 0], [1, 2, 3], [900, 700, 40]]) + first
    grid.add_cells(index, np.array([9, 0, 4]) * ONE, np.array([0, 7, 0]) * ONE)
    return grid


@pytest.mark.parametrize("suffix", [".bt", ".ot"])
def test_a_map_in_utm_coordinates(tmp_path: Path, suffix: str) -> None:
    octomap = pytest.importorskip("octomap")
    view = utm_map().log_odds()
    path = tmp_path / f"a{suffix}"
    with pytest.raises(InputError) as raised:
        view.save_octomap(path)
    # Nothing would be left of a crop, so none is advised; the shift that is does work.
    assert "crop" not in str(raised.value)
    found = re.search(r"--shift (\S+) (\S+) (\S+) moves", str(raised.value))
    assert found is not None
    x, y, z = map(float, found.groups())
    assert (x, y, z) == (500_000.0, 5_400_000.0, 0.0)
    view.save_octomap(path, shift=(x, y, z))
    assert b"# shifted: add 500000 5400000 0 [m]" in path.read_bytes()
    back = load_octomap(path)
    index, log_odds = view.known_log_odds()
    leaf = back.find(index - np.rint(np.array([x, y, z]) / 0.2).astype(np.int64))
    assert (leaf >= 0).all()
    assert back.cell_count == len(index)
    if suffix == ".ot":
        assert np.array_equal(back.log_odds[leaf], log_odds.astype("f4"))
        return
    tree = octomap.OcTree(0.1)
    assert tree.readBinary(str(path).encode())
    for cell, odds in zip(index, log_odds, strict=True):
        node = tree.search((cell + 0.5) * 0.2 - [x, y, z])
        assert tree.isNodeOccupied(node) == (odds > 0)


def test_shifts_are_whole_cells() -> None:
    assert shift_of((0.6, -0.9, 0.0), 0.3).cells.tolist() == [2, -3, 0]
    assert shift_of((500_000, 5_400_000, 0), 0.05).cells.tolist() == [10_000_000, 108_000_000, 0]
    with pytest.raises(ConfigError, match=r"cells of 0.3 m; the nearest is --shift 0.9 0 500000.1"):
        shift_of((1, 0, 500_000), 0.3)
    for wrong in (float("nan"), float("inf"), 1e300):
        with pytest.raises(ConfigError, match="three lengths"):
            shift_of((0, wrong, 0), 0.1)


lengths = st.integers(-(2**36), 2**36)


@given(
    st.tuples(lengths, lengths, lengths),
    st.tuples(*[st.integers(1, 2 * HALF + 3)] * 3),
    st.sampled_from([0.05, 0.1, 0.2, 0.3, 1 / 3, 0.07, 2.0, 25.0]),
)
def test_what_is_advised_works(
    first: tuple[int, int, int], sides: tuple[int, int, int], resolution: float
) -> None:
    lo = np.array(first, np.int64)
    bounds = lo, lo + np.array(sides, np.int64)
    path = Path("a.bt")
    try:
        check_keys(path, bounds, resolution)
    except InputError as error:
        found = re.search(r"--shift (\S+) (\S+) (\S+) moves", str(error))
        too_wide = max(sides) > 2 * HALF
        assert (found is None) == too_wide
        if found is not None:
            shift = shift_of(tuple(map(float, found.groups())), resolution)
            check_keys(path, bounds, resolution, shift)
    else:
        assert (bounds[0] >= -HALF).all()
        assert (bounds[1] <= HALF).all()


def test_large_leaves_are_moved_whole(tmp_path: Path) -> None:
    voxels = VoxelMap(np.array([[8, 0, 0]]), np.array([1.0]), 0.5, np.array([3]))
    voxels.save_octomap(tmp_path / "a.ot", shift=(4.0, -8.0, 0.0))
    assert load_octomap(tmp_path / "a.ot").index.tolist() == [[0, 16, 0]]
    with pytest.raises(InputError, match="leaves of 4 m is shifted by multiples of that, not by 1"):
        voxels.save_octomap(tmp_path / "b.ot", shift=(1.0, 0.0, 0.0))


def test_a_map_that_is_too_wide(tmp_path: Path) -> None:
    wide = VoxelMap(np.array([[0, 0, 0], [70_000, 0, 0]]), np.array([1.0, 1.0]), 0.1)
    with pytest.raises(InputError, match=r"crop to x < 3276\.8 m") as raised:
        wide.save_octomap(tmp_path / "a.bt")
    assert "--shift" not in str(raised.value)
    far = VoxelMap(np.array([[80_000, 0, 0], [150_000, 0, 0]]), np.array([1.0, 1.0]), 0.1)
    with pytest.raises(InputError, match="70001 x 1 x 1: make it of a coarser resolution"):
        far.save_octomap(tmp_path / "a.bt")
