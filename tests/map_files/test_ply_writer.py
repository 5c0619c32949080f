"""PLY of occupied cells, read back by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap import VoxelMap

TYPES = {"double": "<f8", "float": "<f4"}


def read_ply(path: Path) -> tuple[np.ndarray[tuple[int], np.dtype[np.void]], list[str]]:
    head, body = path.read_bytes().split(b"end_header\n", 1)
    lines = head.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    fields = [line.split() for line in lines if line.startswith("property")]
    kind = np.dtype([(name, TYPES[type_]) for _, type_, name in fields])
    (count,) = (int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    assert len(body) == count * kind.itemsize
    return np.frombuffer(body, kind), lines


def test_points(tmp_path: Path) -> None:
    # UTM: 500 km and 5000 km from the origin, where single precision is off by 0.25 m.
    index = np.array(
        [[5_000_000, 50_000_000, -3], [5_000_004, 50_000_000, 4], [5_000_001, 50_000_001, 0]]
    )
    voxels = VoxelMap(index, np.array([2.0, 3.0, -1.0]), 0.1, np.array([0, 2, 0]))
    voxels.save_ply(tmp_path / "map.ply")
    points, lines = read_ply(tmp_path / "map.ply")
    assert "comment cell_size 0.1" in lines
    assert points["x"].dtype == points["y"].dtype == points["z"].dtype == np.float64
    assert points["x"] == pytest.approx([500_000.05, 500_000.6], abs=1e-6)
    assert points["y"] == pytest.approx([5_000_000.05, 5_000_000.2], abs=1e-6)
    assert points["z"] == pytest.approx([-0.25, 0.6], abs=1e-9)
    assert points["size"] == pytest.approx([0.1, 0.4])
    assert points["probability"] == pytest.approx(1 / (1 + np.exp([-2.0, -3.0])))


def test_thresholds_and_names(tmp_path: Path) -> None:
    grid = oddsmap.EvidenceMap(0.25, ndim=3)
    grid.add_cells(np.array([[0, 0, 0], [1, 0, 0]]), np.array([65536, 0]), np.array([0, 65536]))
    grid.log_odds().save_ply(tmp_path / "map.ply")
    assert read_ply(tmp_path / "map.ply")[0]["x"].tolist() == [0.125]
    view = grid.log_odds()
    view.thresholds = oddsmap.Thresholds(free=0.1, occupied=0.99)
    view.save_ply(tmp_path / "none.ply")
    assert len(read_ply(tmp_path / "none.ply")[0]) == 0
    with pytest.raises(oddsmap.ConfigError, match=r"named \.ply"):
        grid.log_odds().to_voxels().save_ply(tmp_path / "map.obj")
    with pytest.raises(oddsmap.OutputError, match="exists already"):
        view.save_ply(tmp_path / "map.ply")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.ply", "none.ply"]


def test_counts(tmp_path: Path) -> None:
    grid = oddsmap.EvidenceMap(0.1, ndim=3)
    # Of the second cell votes are in parts; the third lies beyond OctoMap's keys.
    index = np.array([[0, 0, 0], [1, 0, 0], [5_000_000, 0, 0], [2, 2, 2]])
    hits = np.array([7 * 65536, 3 * 65536 + 32768, 2 * 65536, 0])
    grid.add_cells(index, hits, np.array([65536, 0, 0, 9 * 65536]))
    grid.log_odds().save_ply(tmp_path / "map.ply")
    points, lines = read_ply(tmp_path / "map.ply")
    assert "property float hits" in lines
    order = np.argsort(points["x"])
    assert points["x"][order] == pytest.approx([0.05, 0.15, 500_000.05], abs=1e-6)
    assert points["hits"][order].tolist() == [7.0, 3.5, 2.0]
    assert points["passes"][order].tolist() == [1.0, 0.0, 0.0]
    expected = grid.log_odds().cells()[1]
    assert np.sort(points["probability"]) == pytest.approx(np.sort(expected[expected >= 0.65]))
    with pytest.raises(oddsmap.InputError, match="needs a 3D map"):
        oddsmap.EvidenceMap(0.1).log_odds().save_ply(tmp_path / "flat.ply")
