# SPDX-License-Identifier: Apache-2.0
"""A VoxelGrid for Foxglove, read back by rosbags."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import EvidenceMap, InputError, Thresholds, VoxelMap
from oddsmap.map_files.fields import CellPoints
from oddsmap.map_files.ros_bag import save_bag
from oddsmap.map_files.ros_messages import MapHeader
from oddsmap.map_files.voxel_messages import voxel_messages
from tests.map_files.test_ros_bag import cells_of, read, space_map

pytest.importorskip("rosbags")
LIMITS = Thresholds(0.2, 0.8)


def written(cells: CellPoints, path: Path) -> tuple[npt.NDArray[np.void], npt.NDArray[np.float64]]:
    """The cells of a map, z first, and the corner of the first one."""
    make = voxel_messages(cells, thresholds=LIMITS)
    save_bag(make, path, "mcap", header=MapHeader("odom", 5), force=True)
    ((topic, (grid, connection, stamp)),) = read(path).items()
    assert (topic, connection.msgtype) == ("/map_voxels", "foxglove_msgs/msg/VoxelGrid")
    assert (stamp, grid.timestamp.nanosec, grid.frame_id) == (5, 5, "odom")
    assert grid.slice_stride == grid.row_count * grid.row_stride
    size = grid.cell_size
    assert (size.x, size.y, size.z) == (cells.resolution,) * 3
    corner = grid.pose.position
    shape = (-1, grid.row_count, grid.column_count)
    return cells_of(grid).reshape(shape), np.array([corner.x, corner.y, corner.z])


def test_cells(tmp_path: Path) -> None:
    grid = space_map()
    view = grid.log_odds()
    cells, corner = written(view, tmp_path / "m.mcap")
    lo, hi = view.bounds() or pytest.fail("no cells")
    assert np.array_equal(corner, lo * 0.2)
    seen, p = view.observed(), view.probability()
    assert cells.shape == tuple((hi - lo)[::-1]) == p.shape
    assert np.isnan(cells["probability"][~seen]).all()
    assert np.array_equal(cells["probability"][seen], p[seen].astype("f4"))
    hits, passes = grid.log_odds().evidence.region(lo, hi)
    assert np.array_equal(cells["hits"], hits)
    assert np.array_equal(cells["passes"], passes)
    assert np.array_equal(cells["alpha"], np.where(seen & (p >= 0.8), 255, 0))
    assert np.array_equal(cells["red"][seen], np.rint(255 * (1 - p[seen])))


def test_leaves_fill_all_their_cells(tmp_path: Path) -> None:
    voxels = VoxelMap(
        np.array([[-4, 4, 0], [-3, 1, 5], [1, 1, 1]]), np.array([2.0, 3.0, -1.0]), 0.1,
        np.array([2, 0, 0]),
    )  # fmt: skip
    cells, corner = written(voxels, tmp_path / "m.mcap")
    assert cells.dtype.names == ("probability", "red", "green", "blue", "alpha")
    expected = np.full(cells.shape, np.nan, "f4")
    first = np.rint(corner / 0.1).astype(int)
    for lowest, side, log_odds in (
        ((-4, 4, 0), 4, 2.0),
        ((-3, 1, 5), 1, 3.0),
        ((1, 1, 1), 1, -1.0),
    ):
        x, y, z = np.array(lowest) - first
        expected[z : z + side, y : y + side, x : x + side] = 1 / (1 + np.exp(-log_odds))
    assert np.array_equal(cells["probability"], expected, equal_nan=True)


def test_refusals(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no cells"):
        voxel_messages(EvidenceMap(0.1, ndim=3).log_odds(), thresholds=LIMITS)
    wide = EvidenceMap(0.1, ndim=3)
    wide.add_cells(
        np.array([[0, 0, 0], [999, 999, 99]]), np.array([65536, 0]), np.array([0, 65536])
    )
    with pytest.raises(InputError, match=r"1000 x 1000 x 100 cells.*crop it"):
        voxel_messages(wide.log_odds(), thresholds=LIMITS)
