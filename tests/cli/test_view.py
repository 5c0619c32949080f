# SPDX-License-Identifier: Apache-2.0
"""`oddsmap view`: a page that is served until Ctrl-C, or one file."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import urllib.request
import webbrowser
from pathlib import Path

import numpy as np
import pytest

from oddsmap import EvidenceMap
from oddsmap.kernels.units import ONE
from tests.cli.conftest import Run
from tests.saved_maps_kit import full_map

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    """A map of two cells."""
    grid = EvidenceMap(0.1)
    grid.add_cells(np.array([[0, 0], [5, -3]]), np.array([ONE, 0]), np.array([ONE, 3 * ONE]))
    path = tmp_path / "hall.zarr"
    grid.save(path)
    return path


def test_one_file(run: Run, saved: Path, tmp_path: Path) -> None:
    page = tmp_path / "hall.html"
    done = run("view", saved, "-o", page)
    assert (done.status, done.out) == (0, f"wrote    {page}\n")
    first = page.read_text(encoding="utf-8")
    assert "<title>hall.zarr - oddsmap</title>" in first
    assert "exists already; use --force" in run("view", saved, "-o", page).line
    assert run("view", saved, "-o", page, "--force", "-q").out == ""
    assert page.read_text(encoding="utf-8") == first
    assert {path.name for path in tmp_path.iterdir()} == {"hall.zarr", "hall.html"}


def test_a_map_of_any_kind(run: Run, saved: Path, tmp_path: Path) -> None:
    space = EvidenceMap(0.1, ndim=3)
    space.add_cells(np.array([[0, 0, 0]]), np.array([ONE]), np.array([0]))
    space.save(tmp_path / "space.zarr")
    space.log_odds().save_octomap(tmp_path / "space.ot")
    full_map(1).save(tmp_path / "full.zarr")
    full_map(1).save_ros(tmp_path / "ros.yaml")
    for name in ("space.zarr", "space.ot", "full.zarr", "ros.yaml"):
        page = tmp_path / f"{name}.html"
        assert run("view", tmp_path / name, "-o", page).status == 0
        assert f"<title>{name} - oddsmap</title>" in page.read_text(encoding="utf-8")
    (tmp_path / "seen.csv").write_text("x,y\n0,0\n")
    for name, said in (
        ("ros.pgm", "an image says no resolution"),
        ("seen.csv", "not a table of landmarks"),
    ):
        line = run("view", tmp_path / name, "-o", tmp_path / "m.html").line
        assert line.startswith(f"{tmp_path / name}: ")
        assert said in line
    assert not (tmp_path / "m.html").exists()


def test_maps_beside_another(run: Run, saved: Path, tmp_path: Path) -> None:
    full_map(1).save(tmp_path / "full.zarr")
    full_map(1).save_ros(tmp_path / "ros.yaml")
    page = tmp_path / "m.html"
    others = ("--with", tmp_path / "full.zarr", "--with", tmp_path / "ros.yaml")
    assert run("view", saved, *others, "-o", page).status == 0
    for other, said in (
        (saved, f"--with {saved}: not a map of probabilities; known: a full map"),
        (tmp_path / "ros.pgm", "an image says no resolution"),
        (tmp_path / "none.zarr", "no such file"),
        (page, "not a map of probabilities"),
    ):
        assert said in run("view", saved, "--with", other, "-o", tmp_path / "n.html").line


def test_landmarks_alone_and_on_top(run: Run, saved: Path, tmp_path: Path) -> None:
    trees = tmp_path / "trees.csv"
    trees.write_text("id,x,y,cov_xx,cov_xy,cov_yy,count\n7,0.5,1,0.01,0,0.02,3\n")
    assert run("view", trees, "-o", tmp_path / "alone.html").status == 0
    top = ("--landmarks", trees)
    assert run("view", saved, *top, "-o", tmp_path / "both.html").status == 0
    space = EvidenceMap(0.1, ndim=3)
    space.add_cells(np.array([[0, 0, 0]]), np.array([ONE]), np.array([0]))
    space.save(tmp_path / "space.zarr")
    for shown, said in (
        ((trees, *top), "landmarks lie on top of a map: oddsmap view MAP --landmarks"),
        ((tmp_path / "space.zarr", *top), "landmarks are drawn on 2D maps, this one is 3D"),
        ((saved, "--landmarks", tmp_path / "alone.html"), "not a landmark map in JSON"),
        ((saved, "--landmarks", tmp_path / "none.csv"), "no such file"),
    ):
        assert said in run("view", *shown, "-o", tmp_path / "m.html").line


# Shells let what runs in the background ignore Ctrl-C, and these tests may.
_AS_TYPED = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from oddsmap.cli import main
main()
"""


def test_it_is_served_until_ctrl_c(saved: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", _AS_TYPED, "view", str(saved), "--no-browser"],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")}, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    url = process.stdout.readline().strip()
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{32}/", url)
    with urllib.request.urlopen(url) as answer:  # noqa: S310 - its form is checked above
        assert b"<title>hall.zarr - oddsmap</title>" in answer.read()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (0, "")
    assert out.endswith("ended\n")


@pytest.mark.parametrize("found", [True, False])
def test_the_browser_is_given_the_address(
    run: Run, saved: Path, monkeypatch: pytest.MonkeyPatch, found: bool
) -> None:
    opened: list[str] = []

    def show(url: str) -> bool:
        opened.append(url)
        return found

    def serve(self: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(webbrowser, "open", show)
    monkeypatch.setattr("oddsmap.viewer.server.PageServer.serve_forever", serve)
    done = run("view", saved)
    assert done.status == 0
    assert done.out.splitlines()[0] == opened[0]
    assert ("no browser was found" in done.out) != found
    assert run("view", saved, "--no-browser", "-q").out.count("\n") == 1
    assert len(opened) == 1
