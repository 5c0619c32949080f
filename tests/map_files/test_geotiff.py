# SPDX-License-Identifier: Apache-2.0
"""GeoTIFFs of maps, read back by rasterio."""

from __future__ import annotations

import math
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import ConfigError, EvidenceMap, InputError, OutputError, ProbabilityMap
from oddsmap.map_files.geotiff import save_geotiff
from oddsmap.map_files.plane import ArrayPlane, windows

rasterio = pytest.importorskip("rasterio")
ONE = 65536


def utm_map() -> EvidenceMap:
    """Two clusters at UTM coordinates, with windows between them in which nothing is known."""
    rng = np.random.default_rng(6)
    grid = EvidenceMap(0.25, votes="beam")
    first = np.array([2_000_000, 21_600_000])
    for at in ([0, 0], [4300, 700]):
        index = np.unique(rng.integers(0, 60, (900, 2)), axis=0) + first + at
        grid.add_cells(index, *(rng.integers(0, 9, (2, len(index))) * (ONE // 2)))
    return grid


def test_all_pixels_and_places(tmp_path: Path) -> None:
    grid = utm_map()
    view = grid.log_odds(prior=0.3)
    view.save_geotiff(tmp_path / "a.tif", crs="EPSG:32632")
    lo, hi = grid.bounds() or pytest.fail("no cells")
    seen = view.observed()
    hits, passes = grid.region(lo, hi)
    with rasterio.open(tmp_path / "a.tif") as file:
        assert file.descriptions == ("probability", "hits", "passes")
        assert file.dtypes == ("float32",) * 3
        assert file.crs.to_epsg() == 32632
        assert math.isnan(file.nodata)
        assert file.profile["tiled"]
        assert file.profile["compress"] == "deflate"
        p, *counts = file.read()
        assert np.array_equal(np.isnan(p[::-1]), ~seen)
        assert np.array_equal(p[::-1][seen], view.probability()[seen].astype("f4"))
        assert np.array_equal(counts[0][::-1], hits)
        assert np.array_equal(counts[1][::-1], passes)
        # A cell is found by its place: its centre, and points within it.
        index, _, _ = grid.cells()
        for cell in index[:: len(index) // 5]:
            x, y = (cell + 0.5) * 0.25
            row, column = file.index(x, y)
            assert file.xy(row, column) == pytest.approx((x, y), abs=1e-9)
            (sample,) = file.sample([(x + 0.1, y - 0.1)])
            ((expected,),) = view.probability((cell, cell + 1))
            assert sample[0] == np.float32(expected)
        assert file.bounds == pytest.approx((*(lo * 0.25), *(hi * 0.25)), abs=1e-9)


def test_a_turned_plane_without_counts(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    grid = ProbabilityMap(rng.random((4, 3)), rng.random((4, 3)) < 0.7, 0.5, (10.0, 20.0), 0.3)
    save_geotiff(ArrayPlane(grid), tmp_path / "a.TIF")
    with rasterio.open(tmp_path / "a.TIF") as file:
        assert (file.count, file.crs) == (1, None)
        for (row, column), p in np.ndenumerate(grid.probability):
            along, up = (column + 0.5) * 0.5, (row + 0.5) * 0.5
            x = 10.0 + along * math.cos(0.3) - up * math.sin(0.3)
            y = 20.0 + along * math.sin(0.3) + up * math.cos(0.3)
            assert file.xy(3 - row, column) == pytest.approx((x, y))
            value = file.read(1)[3 - row, column]
            assert value == np.float32(p) if grid.observed[row, column] else math.isnan(value)


@pytest.mark.parametrize(
    ("crs", "message"),
    [
        ("EPSG:4326", "not of a plane in metres"),
        ("EPSG:2263", "counts in US survey foot"),
        ("UTM 32", "not a coordinate reference system that PROJ knows"),
        ("EPSG:99999", "not a coordinate reference system that PROJ knows"),
        ("", "not a coordinate reference system that PROJ knows"),
    ],
)
def test_places_on_the_earth(tmp_path: Path, crs: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as raised:
        utm_map().log_odds().save_geotiff(tmp_path / "a.tif", crs=crs)
    assert "\n" not in str(raised.value)
    assert list(tmp_path.iterdir()) == []


def test_what_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    view = utm_map().log_odds()
    with pytest.raises(ConfigError, match=r"named \.tif"):
        view.save_geotiff(tmp_path / "a.png")
    with pytest.raises(InputError, match="needs a 2D map"):
        EvidenceMap(0.1, ndim=3).log_odds().save_geotiff(tmp_path / "a.tif")
    with pytest.raises(InputError, match="no cells"):
        EvidenceMap(0.1).log_odds().save_geotiff(tmp_path / "a.tif")
    far = EvidenceMap(0.1)
    far.add_cells(np.array([[0, 0], [1 << 18, 1 << 18]]), np.array([ONE, ONE]), np.zeros(2, int))
    with pytest.raises(InputError, match=r"262145 x 262145 cells, of which 1\.72e\+10 can be"):
        far.log_odds().save_geotiff(tmp_path / "a.tif")
    (tmp_path / "a.tif").touch()
    with pytest.raises(OutputError, match="exists already"):
        view.save_geotiff(tmp_path / "a.tif")
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(ConfigError, match=r'pip install "oddsmap\[geo\]"'):
        view.save_geotiff(tmp_path / "b.tif")


@pytest.mark.parametrize("shape", [(1, 1), (256, 4096), (257, 4097), (700, 9000)])
def test_windows(shape: tuple[int, int]) -> None:
    for from_top in (False, True):
        times = np.zeros(shape, np.int8)
        tops: list[Any] = []
        for rows, columns in windows(shape, from_top=from_top):
            times[slice(*rows), slice(*columns)] += 1
            tops.append(shape[0] - rows[1] if from_top else rows[0])
            assert columns[0] % 256 == 0
        assert (times == 1).all()
        assert all(top % 256 == 0 for top in tops)


def test_memory_does_not_grow_with_the_cells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("oddsmap.map_files.plane._COLUMNS", 256)

    def save(rows: int) -> int:
        """What an export takes at most beside the map, without GDAL's cache [bytes]."""
        grid = EvidenceMap(0.1)
        index = np.stack(np.meshgrid(np.arange(256), np.arange(rows)), axis=-1).reshape(-1, 2)
        grid.add_cells(index, index[:, 0] % 3 * ONE, np.full(len(index), ONE))
        tracemalloc.start()
        grid.log_odds().save_geotiff(tmp_path / f"{rows}.tif")
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return peak

    save(256)
    few, many = save(512), save(2048)
    assert many - few < 256 * (2048 - 512)


@pytest.mark.skipif(sys.platform == "win32", reason="limits of files are of Unix")
def test_a_full_disk_is_said(tmp_path: Path) -> None:
    """GDAL writes its last blocks when a file is closed, and does not say what went wrong then."""
    import resource
    import signal

    view = utm_map().log_odds()
    view.save_geotiff(tmp_path / "whole.tif")
    size = (tmp_path / "whole.tif").stat().st_size
    (tmp_path / "whole.tif").unlink()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        for share in (0.05, 0.5, 0.9, 0.99):
            resource.setrlimit(resource.RLIMIT_FSIZE, (int(share * size), before[1]))
            with pytest.raises(OutputError, match=r"a\.tif: cannot be written: "):
                view.save_geotiff(tmp_path / "a.tif")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert list(tmp_path.iterdir()) == []
