# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.simulate import write_carmen
from tests.cli.conftest import Run


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A square room, and something that goes through it."""
    path = tmp_path_factory.mktemp("log") / "room.log"
    angles = np.linspace(-np.pi / 2, np.pi / 2, 181)
    scans = []
    for k in range(12):
        ranges = 4.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
        ranges[40 + 8 * k : 46 + 8 * k] = 2.0
        scans.append(oddsmap.Scan.from_angles((0.03, 0.04, 0.0), angles, ranges, stamp_s=k + 1.0))
    write_carmen(path, scans)
    return path


def test_points_and_map(run: Run, log: Path, tmp_path: Path) -> None:
    cloud, clean = tmp_path / "static.ply", tmp_path / "static.zarr"
    done = run("clean", log, "--resolution", 0.1, "-o", cloud, "-o", clean, "--json")
    assert done.status == 0, done.err
    facts = done.json
    assert (facts["points"], facts["dynamic"]) == (12 * 181, 12 * 6)
    assert facts["points_written"] == 12 * 175
    assert b"element vertex 2100\n" in cloud.read_bytes()
    grid = oddsmap.load_map(clean)
    assert grid.provenance[-1]["cleaned_cells"] == facts["cleaned_cells"] > 0
    whole = oddsmap.build_map(oddsmap.open_log(log), 0.1)
    assert grid.census().hits < whole.census().hits
    assert grid.census().passes == whole.census().passes


def test_with_the_map_that_build_made(run: Run, log: Path, tmp_path: Path) -> None:
    assert run("build", log, "--resolution", 0.1, "-o", tmp_path / "room.zarr").status == 0
    done = run("clean", log, tmp_path / "room.zarr", "--all", "-o", tmp_path / "all.pcd")
    assert "points   2,172, 72 dynamic (3.3 %)" in done.out
    rows = np.frombuffer((tmp_path / "all.pcd").read_bytes()[-2172 * 16 :],
                         np.dtype([("p", "<f4", 3), ("label", "<u4")]))  # fmt: skip
    assert rows["label"].sum() == 72


def test_what_is_refused(run: Run, log: Path, tmp_path: Path) -> None:
    static = tmp_path / "static.ply"
    assert "points are .ply, .pcd" in run("clean", log, "--resolution", 1, "-o", "a.xyz").line
    two = run("clean", log, "--resolution", 1, "-o", static, "-o", tmp_path / "b.pcd")
    assert "one file of points and one map" in two.line
    no_points = run("clean", log, "--resolution", 1, "--all", "-o", tmp_path / "a.zarr")
    assert "--all is of points" in no_points.line
    assert run("clean", log, "-o", static).status == 2
    assert run("clean", log, "--resolution", 1).status == 2
    assert "level" in run("clean", log, "--resolution", 1, "--level", 2, "-o", static).line
    assert run("build", log, "--resolution", 0.5, "-o", tmp_path / "m.zarr").status == 0
    both = run("clean", log, tmp_path / "m.zarr", "--resolution", 1, "-o", static)
    assert "--resolution is of a map that is made" in both.line
    assert not static.exists()
