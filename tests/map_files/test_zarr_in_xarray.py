# SPDX-License-Identifier: Apache-2.0
"""Saved maps as xarray opens them, with the centres of cells as coordinates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap import ConeSensor, EvidenceMap, OutputError, Scan, build_full_map, load_map
from oddsmap.map_files import zarr_folder
from tests.kit import ONE, add_votes

xarray = pytest.importorskip("xarray")


@pytest.mark.parametrize("ndim", [2, 3])
def test_votes_lie_where_the_map_says(tmp_path: Path, ndim: int) -> None:
    grid = EvidenceMap(0.1, ndim=ndim)
    add_votes(grid, {(-7, 30, 2)[:ndim]: (3 * ONE, ONE), (5, -1, 9)[:ndim]: (0, 2 * ONE)})
    grid.save(tmp_path / "a.zarr")
    opened = xarray.open_zarr(tmp_path / "a.zarr", consolidated=False)
    assert opened.hits.dims == opened.passes.dims == ("z", "y", "x")[-ndim:]
    place = dict(zip("xyz", (-0.65, 3.05, 0.25)[:ndim], strict=False))
    assert int(opened.hits.sel(**place, method="nearest")) == 3
    assert int(opened.passes.sel(**place, method="nearest")) == 1
    assert opened.x.attrs["units"] == "m"
    lo, hi = grid.bounds() or ((), ())
    region = tuple(slice((a + 0.1) * 0.1, (b - 0.1) * 0.1) for a, b in zip(lo, hi, strict=True))
    known = opened.sel(dict(zip("xyz", region, strict=False)))
    hits, passes = grid.region(lo, hi)
    np.testing.assert_array_equal(known.hits, hits)  # [votes] both
    np.testing.assert_array_equal(known.passes, passes)
    posterior = grid.log_odds().to_xarray()
    for name in "xyz"[:ndim]:
        np.testing.assert_array_equal(known[name], posterior[name])


def test_a_full_map(tmp_path: Path) -> None:
    sensor = ConeSensor(cone_deg=20.0, range_max=4.0)
    full = build_full_map([Scan.from_cone((0, 0, 0), 0.0, 1.0, cone_deg=20)], 0.5, sensor=sensor)
    full.save(tmp_path / "full.zarr")
    opened = xarray.open_zarr(tmp_path / "full.zarr", consolidated=False)
    bounds = full.bounds()
    assert bounds is not None
    (left, low), (right, high) = (end * 0.5 for end in bounds)
    log_odds = opened.log_odds.sel(x=slice(left, right), y=slice(low, high))
    np.testing.assert_array_equal(log_odds, full.log_odds().astype(np.float32))


def test_an_endless_axis_has_no_coordinates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zarr_folder, "_LONGEST_AXIS", 1024)
    grid = EvidenceMap(0.1)
    add_votes(grid, {(0, 0): (ONE, 0), (0, 2000): (ONE, 0)})
    grid.save(tmp_path / "a.zarr")
    opened = xarray.open_zarr(tmp_path / "a.zarr", consolidated=False)
    assert set(opened.coords) == {"x"}
    assert load_map(tmp_path / "a.zarr").bounds() is not None


def test_a_map_with_coordinates_is_replaced(tmp_path: Path) -> None:
    grid = EvidenceMap(0.1)
    add_votes(grid, {(0, 0): (ONE, 0)})
    grid.save(tmp_path / "a.zarr")
    grid.save(tmp_path / "a.zarr", force=True)
    (tmp_path / "a.zarr" / "x" / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match=r"x/notes.txt, which is no part of the map"):
        grid.save(tmp_path / "a.zarr", force=True)
