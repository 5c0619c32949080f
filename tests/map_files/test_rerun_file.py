# SPDX-License-Identifier: Apache-2.0
"""Recordings of Rerun, read back by rerun-sdk."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import ConfigError, EvidenceMap, InputError, OutputError, ProbabilityMap, VoxelMap
from oddsmap.map_files.plane import ArrayPlane
from oddsmap.map_files.rerun_file import save_rerun_plane

ONE = 65536


def some_map(ndim: int, first: tuple[int, ...] = (0, 0, 0), resolution: float = 0.2) -> EvidenceMap:
    rng = np.random.default_rng(5)
    grid = EvidenceMap(resolution, votes="beam", ndim=ndim)
    index = np.unique(rng.integers(-9, 12, (900, ndim)), axis=0) + first[:ndim]
    grid.add_cells(index, *(rng.integers(0, 9, (2, len(index))) * (ONE // 2)))
    return grid


def read(path: Path) -> dict[str, dict[str, Any]]:
    """What each entity has, by the names of its components."""
    reader = (
        pytest.importorskip("rerun.chunk").RrdReader
        if path.suffix == ".rrd"
        else pytest.importorskip("rerun.chunk").McapReader
    )
    found: dict[str, dict[str, Any]] = {}
    for chunk in reader(str(path)).stream():
        batch = chunk.to_record_batch()
        entity = found.setdefault(chunk.entity_path, {})
        entity |= {
            name: batch.column(name).to_pylist()[0]
            for name in batch.schema.names
            if name.startswith(("GridMap:", "VoxelGridMap:", "hits", "passes"))
        }
    return found


def test_a_plane(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    view = some_map(2).log_odds(prior=0.3)
    view.save_rerun(tmp_path / "m.rrd")
    grid = read(tmp_path / "m.rrd")["/map"]
    lo, hi = view.bounds() or pytest.fail("no cells")
    form = grid["GridMap:format"][0]
    assert (form["width"], form["height"]) == tuple(hi - lo)
    # The first row of an image is the top one, the highest y.
    cells = np.array(grid["GridMap:data"][0], np.uint8).reshape(form["height"], form["width"])[::-1]
    expected = np.where(view.observed(), np.rint(100 * view.probability()), 255)
    assert np.array_equal(cells, expected)
    assert grid["GridMap:cell_size"] == [np.float32(0.2)]
    assert grid["GridMap:translation"][0] == pytest.approx([*(lo * 0.2), 0.0])


def test_rerun_makes_the_same_of_messages_of_ros(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    pytest.importorskip("rosbags")
    view = some_map(2, (30, -80)).log_odds()
    view.save_rerun(tmp_path / "m.rrd")
    view.save_rosbag(tmp_path / "m.mcap", mode="raw")
    assert read(tmp_path / "m.rrd")["/map"] == read(tmp_path / "m.mcap")["/map"]


def test_a_turned_plane(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    seen = np.array([[True, True, False], [True, True, True]])
    grid = ProbabilityMap(np.array([[0.0, 0.5, 0.2], [1.0, 0.25, 0.9]]), seen, 0.5, (1.0, -2.0),
                          yaw=math.pi / 2)  # fmt: skip
    save_rerun_plane(ArrayPlane(grid), tmp_path / "m.rrd")
    found = read(tmp_path / "m.rrd")["/map"]
    assert list(found["GridMap:data"][0]) == [100, 25, 90, 0, 50, 255]
    assert found["GridMap:quaternion"][0] == pytest.approx([0, 0, math.sqrt(0.5), math.sqrt(0.5)])
    assert found["GridMap:translation"] == [[1.0, -2.0, 0.0]]


def test_space(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    grid = some_map(3)
    view = grid.log_odds()
    view.save_rerun(tmp_path / "m.rrd")
    found = read(tmp_path / "m.rrd")["/map"]
    index, p = view.cells()
    occupied = p >= 0.65
    assert np.array_equal(found["VoxelGridMap:voxel_indices"], index[occupied])
    assert np.array_equal(found["VoxelGridMap:values"], p[occupied].astype("f4"))
    assert found["VoxelGridMap:voxel_size"] == [[np.float32(0.2)] * 3]
    assert found["VoxelGridMap:translation"][0] == pytest.approx([0, 0, 0], abs=1e-9)
    _, hits, passes = grid.cells()
    assert np.array_equal(found["hits"], (hits[occupied] / ONE).astype("f4"))
    assert np.array_equal(found["passes"], (passes[occupied] / ONE).astype("f4"))


@pytest.mark.parametrize("shift", [None, (0.2, 0.0, -0.4)])
def test_leaves_of_an_octomap(tmp_path: Path, shift: tuple[float, float, float] | None) -> None:
    pytest.importorskip("rerun")
    voxels = VoxelMap(
        np.array([[8, 0, 0], [-4, 4, 0], [-3, 1, 5], [1, 1, 1]]), np.array([2.0, 1.5, 3.0, -1.0]),
        0.2, np.array([2, 2, 0, 0]),
    )  # fmt: skip
    voxels.save_rerun(tmp_path / "m.rrd", shift=shift)
    found = read(tmp_path / "m.rrd")
    names = {name for name, entity in found.items() if "VoxelGridMap:values" in entity}
    assert names == {"/map", "/map/x4"}
    boxes = {
        tuple(np.round(lowest * 1e4).astype(int)): side
        for name in names
        for side in [found[name]["VoxelGridMap:voxel_size"][0][0]]
        for lowest in np.array(found[name]["VoxelGridMap:voxel_indices"]) * side
        + found[name]["VoxelGridMap:translation"][0]
    }
    moved = np.array(shift or (0, 0, 0))
    expected = {
        tuple(np.round((np.array(cell) * 0.2 - moved) * 1e4).astype(int)): np.float32(side)
        for cell, side in (((8, 0, 0), 0.8), ((-4, 4, 0), 0.8), ((-3, 1, 5), 0.2))
    }
    assert boxes == expected


@pytest.mark.parametrize("ndim", [2, 3])
def test_far_maps_are_shifted(tmp_path: Path, ndim: int) -> None:
    pytest.importorskip("rerun")
    far = (2_500_000, 27_000_000, 100)
    view, near = some_map(ndim, far).log_odds(), some_map(ndim).log_odds()
    with pytest.raises(InputError, match=r"5\d{6} m from the origin.* --shift (\S+) (\S+) ") as end:
        view.save_rerun(tmp_path / "m.rrd")
    said = str(end.value).split("--shift ")[1].split()
    view.save_rerun(tmp_path / "said.rrd", shift=(float(said[0]), float(said[1]), float(said[2])))
    view.save_rerun(tmp_path / "m.rrd", shift=(500_000.0, 5_400_000.0, 20.0 * (ndim == 3)))
    near.save_rerun(tmp_path / "near.rrd")
    one, other = (read(tmp_path / name)["/map"] for name in ("m.rrd", "near.rrd"))
    place = "GridMap:translation" if ndim == 2 else "VoxelGridMap:translation"
    assert one.pop(place)[0] == pytest.approx(other.pop(place)[0], abs=1e-6)
    assert one == other


def test_an_empty_space(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    EvidenceMap(0.1, ndim=3).log_odds().save_rerun(tmp_path / "m.rrd")
    assert not read(tmp_path / "m.rrd")["/map"]["VoxelGridMap:voxel_indices"]


def test_refusals(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    view = some_map(2).log_odds()
    with pytest.raises(ConfigError, match=r"named \.rrd"):
        view.save_rerun(tmp_path / "m.rr")
    view.save_rerun(tmp_path / "m.rrd")
    with pytest.raises(OutputError, match="exists already"):
        view.save_rerun(tmp_path / "m.rrd")
    view.save_rerun(tmp_path / "m.rrd", force=True)


def test_without_rerun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    for ndim in (2, 3):
        with pytest.raises(ConfigError, match=r'pip install "oddsmap\[rerun\]"'):
            some_map(ndim).log_odds().save_rerun(tmp_path / "m.rrd")
    assert list(tmp_path.iterdir()) == []
