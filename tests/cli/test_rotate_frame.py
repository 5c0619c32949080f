# SPDX-License-Identifier: Apache-2.0
"""`oddsmap rotate-frame`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import oddsmap
from tests.cli.conftest import Run


def test_turned_and_back(run: Run, tmp_path: Path) -> None:
    grid = oddsmap.EvidenceMap(0.1, ndim=3)
    index = np.array([[1, 2, 3], [-4, 5, 60]])
    grid.add_cells(index, np.array([5, 0]), np.array([0, 7]))
    first, second, third = (tmp_path / f"{name}.zarr" for name in "abc")
    grid.save(first)
    done = run("rotate-frame", first, "--up=-y", "-o", second)
    assert done.status == 0
    assert done.out.startswith("turned   x was x, y was z, z was -y\n")
    done = run("rotate-frame", second, "--axes", "x,-z, y", "-o", third)
    assert done.out.startswith("turned   x was x, y was -z, z was y\n")
    for one, other in zip(grid.cells(), oddsmap.load_map(third).cells(), strict=True):
        assert np.array_equal(one, other)
    assert "one of the two" in run("rotate-frame", first, "-o", tmp_path / "d.zarr").line
    wrong = run("rotate-frame", first, "--axes", "x y -z", "-o", tmp_path / "d.zarr").line
    assert "a.zarr: axes 'x y -z' are a mirror image" in wrong
    assert not (tmp_path / "d.zarr").exists()


def test_a_map_and_the_same_turned_are_doubted(run: Run, office: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "a.zarr", tmp_path / "b.zarr"
    assert run("build", office, "--resolution", 0.1, "-o", first).status == 0
    assert run("rotate-frame", first, "--axes", "y -x", "-o", second).status == 0
    said = "it is turned (y -x), and both are of one log: they are not of one frame"
    for done in (
        run("compare", first, second),
        run("merge", first, second, "-o", tmp_path / "c.zarr"),
    ):
        assert done.status == 0
        assert said in (done.out + done.err).replace("\n", " ")
    back = tmp_path / "back.zarr"
    assert run("rotate-frame", second, "--axes", "-y x", "-o", back).status == 0
    done = run("compare", first, back)
    assert "frame" not in done.out + done.err
    assert "100.00% have the same state" in done.out
