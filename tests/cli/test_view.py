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
from typing import Any

import numpy as np
import pytest

from oddsmap import EvidenceMap, build_map, load_map, open_log
from oddsmap.kernels.units import ONE
from tests.cli.conftest import Run
from tests.kit import votes_of
from tests.saved_maps_kit import full_map
from tests.viewer.journey_kit import read_payload
from tests.viewer.payload_kit import cells_of

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


def data_of(page: Path) -> tuple[bytes, bytes | None]:
    """What the page holds of a map, and of its log."""
    text = page.read_text(encoding="utf-8")
    found = {
        name: bytes_of(part, int(size))
        for name, size, part in re.findall(
            r'<script type="text/plain" id="(\w+)" data-bytes="(\d+)">([^<]*)<', text
        )
    }
    return found["payload"], found.get("log")


def bytes_of(text: str, length: int) -> bytes:
    """`oddsmap.viewer.text` undone, in whole numbers of a thousand digits."""
    digits = {
        chr(code): i for i, code in enumerate(c for c in range(33, 127) if chr(c) not in '"&<')
    }
    parts = []
    for at in range(0, len(text), 2000 - 2000 % 16):
        block, whole = text[at : at + 2000 - 2000 % 16], 0
        for a, b in zip(block[::2], block[1::2], strict=True):
            whole = whole << 13 | (digits[a] * 91 + digits[b])
        parts.append(whole.to_bytes(len(block) // 16 * 13, "big"))
    return b"".join(parts)[:length]


def test_a_map_with_its_log(run: Run, office: Path, tmp_path: Path) -> None:
    build_map(open_log(office), 0.1).save(tmp_path / "m.zarr")
    alone, both = tmp_path / "alone.html", tmp_path / "both.html"
    assert run("view", tmp_path / "m.zarr", "-o", alone).status == 0
    done = run("view", tmp_path / "m.zarr", office, "-o", both)
    assert (done.out, done.err) == (f"wrote    {both}\n", "")
    (of_map, nothing), (same, log) = data_of(alone), data_of(both)
    assert nothing is None
    assert log is not None
    assert same == of_map
    journey = read_payload(log)
    assert journey.facts["why"] == ["oddsmap", "why", "m.zarr", "office.log.gz"]
    assert (journey.facts["served"], journey.facts["kept"]) == (False, True)
    assert journey.facts["build"] is None
    assert len(journey.places) == len(journey.ends) == 20
    for place, pose in zip(journey.places, open_log(office).poses, strict=True):
        assert place == pytest.approx(pose.translation, abs=1e-4)
    assert str(tmp_path) not in both.read_text(encoding="utf-8")


def test_a_log_alone_is_mapped_as_build_does(run: Run, office: Path, tmp_path: Path) -> None:
    page, built = tmp_path / "office.html", tmp_path / "built.zarr"
    for words, side in (([], "0.05"), (["--resolution", "0.2"], "0.2")):
        done = run("view", office, "-o", page, *words, "--force")
        command = f"oddsmap build office.log.gz --resolution {side} -o office.zarr"
        assert f"mapped   office.log.gz at {side} m" in done.out
        assert ("--resolution sets another side" in done.out) == (not words)
        assert command.replace("office.log.gz", str(office)) in done.out, "it runs as it is"
        assert run("build", office, "--resolution", side, "-o", built, "--force").status == 0
        payload, log = data_of(page)
        one = 65536
        votes = {cell: (h / one, p / one) for cell, (h, p) in votes_of(load_map(built)).items()}
        assert cells_of(payload) == votes
        assert log is not None
        assert read_payload(log).facts["build"] == command


def test_the_coarser_side_of_wide_beams_and_of_space(run: Run, tmp_path: Path) -> None:
    flat = np.array([[0.0, 0.0, 0.1, 2.0], [0.1, 0.0, 0.5, 1.5]])
    space = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0]])
    logs: tuple[tuple[str, dict[str, Any], str], ...] = (
        ("sonar", {"beams": flat, "cone_deg": 25.0, "range_max": 3.0}, "0.1"),
        ("space", {"beams": space, "range_max": 3.0}, "0.1"),
        ("laser", {"beams": flat, "cone_deg": 0.5, "range_max": 3.0}, "0.05"),
    )
    for name, arrays, side in logs:
        np.savez(tmp_path / f"{name}.npz", **arrays)
        done = run("view", tmp_path / f"{name}.npz", "-o", tmp_path / f"{name}.html")
        assert f"at {side} m" in done.out


def test_options_of_the_log_are_in_the_commands(run: Run, office: Path, tmp_path: Path) -> None:
    page = tmp_path / "m.html"
    assert run("view", office, "-o", page, "--skip-bad", "--resolution", "0.2").status == 0
    log = data_of(page)[1]
    assert log is not None
    facts = read_payload(log).facts
    assert facts["options"] == ["--skip-bad"]
    assert "office.log.gz --skip-bad --resolution 0.2" in facts["build"]


def test_what_does_not_go_together(run: Run, saved: Path, office: Path, tmp_path: Path) -> None:
    page = tmp_path / "m.html"
    space = EvidenceMap(0.1, ndim=3)
    space.add_cells(np.array([[0, 0, 0]]), np.array([ONE]), np.array([0]))
    space.save(tmp_path / "space.zarr")
    for words, said in (
        ([saved, "--resolution", "1"], "--resolution is for a log given alone"),
        ([saved, office, "--resolution", "1"], "--resolution is for a log given alone"),
        ([saved, "--skip-bad"], "--skip-bad says how a log is read"),
        ([saved, saved], "is a saved map, not a log"),
        ([office, office], "not a saved map"),
        ([tmp_path / "space.zarr", office], "its scans are 2D, space.zarr is a 3D map"),
        ([saved, tmp_path / "gone.log"], "no such file"),
        ([office, "--resolution", "0"], "resolution"),
    ):
        assert said in run("view", *words, "-o", page).line
    assert not page.exists()
    grid = load_map(saved)
    grid.record("other.log", scans=3)
    grid.save(saved, force=True)
    done = run("view", saved, office, "-o", page)
    assert done.err == f"{office}: hall.zarr says that it was made of other.log, not of this log\n"


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
