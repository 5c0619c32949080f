# SPDX-License-Identifier: Apache-2.0
"""The pages for beginners: their commands and blocks run as they stand, from top to bottom."""

from __future__ import annotations

import re
import shlex
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap.cli import main
from oddsmap.simulate import Lidar2D, Lidar3D, drive3d, office_drive, office_plan, town
from tests.fuzz.mutant import Files
from tests.fuzz.samples import SAMPLES
from tests.test_docs import blocks, commands

ROOT = Path(__file__).resolve().parents[1]


ELSEWHERE = ("oddsmap doctor oddsmap-demo/office.log.gz",)
"""Runs in the test of the README, and takes long."""


def command(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a command as a shell would."""
    monkeypatch.setattr(sys, "argv", shlex.split(line))
    with pytest.raises(SystemExit) as end:
        main()
    assert not end.value.code, line


def page_runs(name: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Run a page in this folder; returns the names that its blocks of Python leave."""
    names: dict[str, Any] = {"__name__": "__main__"}
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    for language, block in blocks(text):
        if language == "python":
            exec(compile(block, name, "exec"), names)
        else:
            assert language == "sh"
            for line in commands(block):
                if line not in ELSEWHERE:
                    command(line, monkeypatch)
    return names


def same(one: oddsmap.EvidenceMap, other: oddsmap.EvidenceMap) -> bool:
    return all(map(np.array_equal, one.cells(), other.cells()))


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_ten_minutes(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    page_runs("start-here.md", monkeypatch)
    said = capsys.readouterr().out
    assert "81.83 m occurs 1561 times" in said
    assert "18 of 320 scans voted: 0 hits, 18 passes" in said
    assert [path.name for path in Path().iterdir()] == ["oddsmap-demo"]


@pytest.mark.realdata
def test_the_real_log(
    data_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = data_folder / "laser2d" / "intel-corrected.log.gz"
    text = (ROOT / "docs" / "start-here.md").read_text(encoding="utf-8")
    lines = re.findall(r"^    (oddsmap .*intel.*)$", text, flags=re.MULTILINE)
    assert len(lines) == 3
    for line in lines:
        command(line.replace(log.name, log.as_posix()), monkeypatch)
    said = "".join(capsys.readouterr())
    for figure in ("159,628 beams", "570.2 square metres", "4 of 910 time stamps"):
        assert figure in " ".join(said.split())


def test_a_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    names = page_runs("from-a-folder.md", monkeypatch)
    assert same(names["grid"], oddsmap.load_map("drive.zarr"))
    assert same(names["grid"], oddsmap.load_map("named.zarr"))


def test_a_bag(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rosbags")
    from tests.recordings.bags import Messages
    from tests.recordings.test_recorded_log import drive

    Messages("mcap").write(Path("run"), drive(Messages("mcap")))
    names = page_runs("from-a-bag.md", monkeypatch)
    said = capsys.readouterr().out
    shown = (ROOT / "docs" / "from-a-bag.md").read_text(encoding="utf-8")
    for line in re.findall(r"^    ((?:topics|scans|poses|map it) .*)$", shown, flags=re.MULTILINE):
        assert line in said
    assert same(names["grid"], oddsmap.load_map("chosen.zarr"))


OTHER_FILES = {
    "carmen.log.gz": "carmen-gz", "drive.rawlog": "rawlog", "flight.laz": "laz",
    "station.e57": "e57", "station.ptx": "ptx", "hall.ply": "ply-ascii",
    "town.graph": "octomap-graph", "argoverse": "argoverse-sweep", "scenes": "rgbd-7scenes",
    "tum": "rgbd-tum", "seen.npz": "npz-grids", "trees.csv": "landmark-csv",
}  # fmt: skip
"""What the page on other files calls its files, and the samples that they are."""


def write_sample(name: str, files: Files) -> None:
    """A folder of that name, or a file, with what it needs beside it."""
    for inner, content in files.items():
        if not Path(name).suffix:
            path = Path(name, inner)
        else:
            path = Path(name if Path(inner).suffix == Path(name).suffix else inner)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def test_other_files(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "docs" / "from-other-files.md").read_text(encoding="utf-8")
    lines = re.findall(r"\| `(oddsmap [^`]+)` \|", text)
    lasers = SAMPLES["carmen-robotlaser"]()["a.log"].decode().splitlines()[2:]
    graph = "".join(f"VERTEX_SE2 {i} {i / 5} 0.1 0\n{line}\n" for i, line in enumerate(lasers))
    Path("graph.g2o").write_text(graph)
    needs = {"flight.laz": "laspy", "station.e57": "pye57", "argoverse": "pyarrow"}
    assert {shlex.split(line)[2] for line in lines} == {"graph.g2o", *OTHER_FILES}
    for line in lines:
        _, _, log, *_, output = shlex.split(line)
        if log in needs and find_spec(needs[log]) is None:
            continue
        if log in OTHER_FILES:
            write_sample(log, SAMPLES[OTHER_FILES[log]]())
        command(line, monkeypatch)
        assert Path(output).exists()
    page_runs("from-other-files.md", monkeypatch)
    (made,) = oddsmap.load_map("lidar.zarr").provenance
    assert (made["scans"], made["beams"]) == (40, 40 * 340)
    assert made["skipped"] == {"beam.nan": 40 * 20}
    assert "warning" not in capsys.readouterr().err.partition("lidar.npz")[2]


def maps_to_write() -> list[str]:
    """Makes the maps of the page on what is written of maps; its commands."""
    plan, lidar, rng = office_plan(), Lidar2D(), np.random.default_rng(0)
    scans = [lidar.scan(plan, pose, rng) for pose in office_drive(20)]
    oddsmap.build_map(scans, 0.1).save("plan.zarr")
    world, spinning = town(flat=True), Lidar3D()
    clouds = [spinning.scan(world, pose, rng) for pose in drive3d(2)]
    oddsmap.build_map(clouds, 0.5).save("space.zarr")
    text = (ROOT / "docs" / "maps-out.md").read_text(encoding="utf-8")
    lines = re.findall(r"\| `(oddsmap [^`]+)` \|", text)
    assert len(lines) >= 16
    return lines


def test_maps_out(monkeypatch: pytest.MonkeyPatch) -> None:
    needs = {".mcap": "rosbags", ".bag": "rosbags", "_bag": "rosbags", ".tif": "rasterio",
             ".laz": "lazrs"}  # fmt: skip
    for line in maps_to_write():
        if line.endswith("--foxglove"):
            continue  # which serves until Ctrl-C, see tests/viewer/test_foxglove_server.py
        output = next(word for word in shlex.split(line)[3:] if word != "-o")
        if output.endswith(".rrd"):
            continue  # by the next test, for its package is large
        missing = [name for end, name in needs.items() if output.endswith(end)]
        if missing and not pytest.importorskip(missing[0]):
            continue
        command(line, monkeypatch)
        assert Path(output).exists()
    page_runs("maps-out.md", monkeypatch)


def test_maps_out_to_rerun(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rerun")
    for line in maps_to_write():
        if line.endswith(".rrd"):
            command(line, monkeypatch)
            assert Path(shlex.split(line)[3]).exists()


def test_questions_and_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    page_runs("faq.md", monkeypatch)
