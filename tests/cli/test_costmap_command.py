# SPDX-License-Identifier: Apache-2.0
"""`oddsmap costmap`: a map as a ROS map of costs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.kernels.units import ONE
from tests.cli.conftest import Run


@pytest.fixture
def maps(tmp_path: Path) -> Path:
    """A hall in 2D, and the same as a layer of space."""
    cells = np.array(list(np.ndindex(30, 20)))
    for name, ndim in (("hall", 2), ("space", 3)):
        grid = oddsmap.EvidenceMap(0.1, ndim=ndim)
        index = np.pad(cells, ((0, 0), (0, ndim - 2)), constant_values=4)
        wall = (cells[:, 0] == 15).astype(np.int64)
        grid.add_cells(index, 9 * ONE * wall, 9 * ONE * (1 - wall))
        grid.save(tmp_path / f"{name}.zarr")
    return tmp_path


def test_the_file_has_the_costs_of_the_view(run: Run, maps: Path) -> None:
    out = maps / "costs.yaml"
    words = ("--inscribed-radius", 0.2, "--inflation-radius", 0.8, "--cost-scaling-factor", 3)
    done = run("costmap", maps / "hall.zarr", out, *words)
    assert done.status == 0, done.err
    assert "16.7 % in collision" in done.out
    assert "0.0 % unknown" in done.out
    assert "costs.pgm" in done.out
    view = oddsmap.load_map(maps / "hall.zarr").log_odds()
    want = view.costmap(0.2, inflation_radius=0.8, cost_scaling_factor=3.0)
    found = oddsmap.load_ros(out)
    assert np.array_equal(np.rint(100 * found.probability), want.occupancy)
    assert found.origin == want.origin
    heights = ("--z-min", 0.4, "--z-max", 0.5)
    assert run("costmap", maps / "space.zarr", maps / "s.yaml", *words, *heights).status == 0
    again = oddsmap.load_ros(maps / "s.yaml")
    assert np.array_equal(again.probability, found.probability)
    assert run("costmap", out, maps / "again.yaml", *words, "--quiet").out == ""


def test_thresholds_and_unknown_cells(run: Run, maps: Path) -> None:
    words = ("costmap", maps / "hall.zarr", maps / "c.yaml", "--inscribed-radius", 0.2, "--force")
    assert "100.0 % unknown" in run(*words, "--occupied", 0.999999, "--free", 1e-9).out
    view = oddsmap.load_map(maps / "hall.zarr").log_odds()
    for option, name in (
        ("--inflate-unknown", "inflate_unknown"),
        ("--inflate-around-unknown", "inflate_around_unknown"),
    ):
        assert run(*words, option).status == 0
        found = oddsmap.load_ros(maps / "c.yaml")
        want = view.costmap(0.2, **{name: True})  # type: ignore[arg-type]
        assert np.array_equal(np.rint(100 * found.probability), want.occupancy)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("hall.zarr", "c.png"), "named by its .yaml"),
        (("hall.zarr", "c.yaml", "--inscribed-radius", "0.9"), "less than inscribed_radius 0.9"),
        (("hall.zarr", "c.yaml", "--inflation-radius", "-1"), "inflation_radius is at least 0"),
        (("hall.zarr", "c.yaml", "--free", "2"), "0 <= free"),
        (("hall.zarr", "c.yaml", "--z-min", "0"), "need a 3D map"),
        (("space.zarr", "c.yaml"), "this map is 3D: say which heights"),
        (("space.zarr", "c.yaml", "--z-min", "1", "--z-max", "0"), "--z-min has to lie below"),
        (("none.zarr", "c.yaml"), "no such file"),
        (("hall.zarr", "there.yaml"), "--force"),
    ],
)
def test_what_is_refused(
    run: Run, maps: Path, words: tuple[str, ...], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(maps)
    Path("there.yaml").touch()
    radius = () if "--inscribed-radius" in words else ("--inscribed-radius", "0.2")
    assert said in run("costmap", *words, *radius).line
    assert not Path("c.yaml").exists()
