# SPDX-License-Identifier: Apache-2.0
"""LAS and LAZ of occupied cells, read back by laspy."""

from __future__ import annotations

import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from oddsmap import ConfigError, EvidenceMap, InputError, OutputError, VoxelMap

laspy = pytest.importorskip("laspy")
ONE = 65536


def space_map(resolution: float = 0.1, ndim: int = 3) -> EvidenceMap:
    rng = np.random.default_rng(8)
    grid = EvidenceMap(resolution, votes="beam", ndim=ndim)
    index = np.unique(rng.integers(-20, 20, (3000, ndim)), axis=0)
    index += np.array([5_000_000, 54_000_000, -300])[:ndim]  # UTM
    grid.add_cells(index, *(rng.integers(0, 9, (2, len(index))) * (ONE // 4)))
    return grid


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize("resolution", [0.1, 1 / 3])
def test_points(tmp_path: Path, suffix: str, resolution: float) -> None:
    if suffix == "laz":
        pytest.importorskip("lazrs")
    grid = space_map(resolution)
    view = grid.log_odds()
    path = tmp_path / f"a.{suffix}"
    view.save_las(path)
    index, hits, passes = grid.cells()
    p = view.cells()[1]
    occupied = p >= 0.65
    with laspy.open(path) as file:
        assert file.header.point_count == occupied.sum()
        assert str(file.header.version) == "1.4"
        assert file.header.are_points_compressed == (suffix == "laz")
        points = file.read()
    centres = (index[occupied] + 0.5) * resolution
    assert np.abs(points.xyz - centres).max() < 1e-8 < resolution / 1e6
    assert np.array_equal(np.floor(points.xyz / resolution).astype(int), index[occupied])
    assert points.header.mins == pytest.approx(centres.min(axis=0), abs=1e-8)
    assert points.header.maxs == pytest.approx(centres.max(axis=0), abs=1e-8)
    assert np.array_equal(points["probability"], p[occupied].astype("f4"))
    assert np.array_equal(points["hits"], (hits[occupied] / ONE).astype("f4"))
    assert np.array_equal(points["passes"], (passes[occupied] / ONE).astype("f4"))
    assert np.unique(points["size"]).tolist() == [np.float32(resolution)]
    assert np.unique(points.return_number).tolist() == [1]


def test_leaves_of_an_octomap(tmp_path: Path) -> None:
    voxels = VoxelMap(
        np.array([[8, 0, 0], [-3, 1, 5], [1, 1, 1]]), np.array([2.0, 3.0, -1.0]), 0.2,
        np.array([2, 0, 0]),
    )  # fmt: skip
    voxels.save_las(tmp_path / "a.las")
    points = laspy.read(tmp_path / "a.las")
    assert list(points.point_format.extra_dimension_names) == ["probability", "size"]
    order = np.argsort(points.x)
    assert points.xyz[order] == pytest.approx(np.array([[-0.5, 0.3, 1.1], [2.0, 0.4, 0.4]]))
    assert points["size"][order] == pytest.approx([0.2, 0.8])


def test_a_place_on_the_earth(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    pytest.importorskip("rasterio")
    view = space_map().log_odds()
    view.save_las(tmp_path / "a.las", crs="EPSG:25832")
    assert laspy.read(tmp_path / "a.las").header.parse_crs().to_epsg() == 25832
    with pytest.raises(ConfigError, match="not of a plane in metres"):
        view.save_las(tmp_path / "b.las", crs="EPSG:4326")


def test_what_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    view = space_map().log_odds()
    with pytest.raises(ConfigError, match=r"named \.las or \.laz"):
        view.save_las(tmp_path / "a.xyz")
    with pytest.raises(InputError, match="needs a 3D map"):
        space_map(ndim=2).log_odds().save_las(tmp_path / "a.las")
    wide = EvidenceMap(1.0, ndim=3)
    wide.add_cells(np.array([[0, 0, 0], [1 << 31, 0, 0]]), np.array([ONE, ONE]), np.zeros(2, int))
    with pytest.raises(InputError, match=r"room for 2\^30 cells"):
        wide.log_odds().save_las(tmp_path / "a.las")
    EvidenceMap(0.1, ndim=3).log_odds().save_las(tmp_path / "none.las")
    assert laspy.read(tmp_path / "none.las").header.point_count == 0
    with pytest.raises(OutputError, match="exists already"):
        view.save_las(tmp_path / "none.las")
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(ConfigError, match=r'pip install "oddsmap\[survey\]"'):
        view.save_las(tmp_path / "b.las")
    assert [entry.name for entry in tmp_path.iterdir()] == ["none.las"]


def test_memory_does_not_grow_with_the_cells(tmp_path: Path) -> None:
    def save(side: int) -> int:
        """What an export takes at most beside the map [bytes]."""
        grid = EvidenceMap(0.1, ndim=3)
        index = np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3)
        grid.add_cells(index, index.sum(axis=1) % 3 * ONE, np.zeros(len(index), int))
        tracemalloc.start()
        grid.log_odds().save_las(tmp_path / f"{side}.las")
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return peak

    save(8)
    few, many = save(48), save(96)
    assert many - few < 16 * (96**3 - 48**3)


@pytest.mark.skipif(sys.platform == "win32", reason="limits of files are of Unix")
@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_a_full_disk_is_said(tmp_path: Path, suffix: str) -> None:
    import resource
    import signal

    view, path = space_map().log_odds(), tmp_path / f"a.{suffix}"
    view.save_las(path)
    size = path.stat().st_size
    path.unlink()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        for most in (10, 500, size // 2, size - 1):
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
            with pytest.raises(OutputError, match="cannot be written: "):
                view.save_las(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert list(tmp_path.iterdir()) == []
