# SPDX-License-Identifier: Apache-2.0
"""`oddsmap subtract MAP LOG`: what a log added to a map is taken out of it again, exactly."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

import oddsmap
from tests.cli.conftest import Run, folder_bytes
from tests.kit import votes_of


@pytest.fixture
def logs(office: Path, tmp_path: Path) -> list[Path]:
    """The office in two logs, and the second one's name again in another folder."""
    lines = gzip.decompress(office.read_bytes()).decode().splitlines(keepends=True)
    scans = [line for line in lines if line.startswith("FLASER")]
    (tmp_path / "other").mkdir()
    paths = [tmp_path / "a.log", tmp_path / "b.log", tmp_path / "other" / "b.log"]
    for path, part in zip(paths, (scans[:8], scans[8:15], scans[15:]), strict=True):
        path.write_text("".join(part))
    return paths


@pytest.fixture
def clouds(tmp_path: Path) -> list[Path]:
    """Two folders of clouds."""
    rng = np.random.default_rng(3)
    folders = [tmp_path / "north", tmp_path / "south"]
    for folder in folders:
        folder.mkdir()
        for i in range(3):
            points = rng.normal(size=(200, 3))
            points *= 3.0 / np.linalg.norm(points, axis=1, keepdims=True)
            np.c_[points, np.zeros(200)].astype(np.float32).tofile(folder / f"{i}.bin")
        (folder / "poses.txt").write_text(
            "".join(f"1 0 0 {i} 0 1 0 {len(folder.name) - 5} 0 0 1 0\n" for i in range(3))
        )
    return folders


def built(run: Run, out: Path, *words: object) -> Path:
    done = run("build", *words, "-o", out)
    assert done.status == 0, done.err
    return out


def assert_same(path: Path, other: Path) -> None:
    """The same evidence, settings and provenance."""
    one, two = oddsmap.load_map(path), oddsmap.load_map(other)
    assert votes_of(one) == votes_of(two)
    if one.lengths is not None:
        for here, there in zip(one.cell_lengths(), two.cell_lengths(), strict=True):
            np.testing.assert_array_equal(here, there)
    assert (one.config, one.provenance) == (two.config, two.provenance)


WAYS: list[list[object]] = [
    [],
    ["--votes", "beam"],
    ["--hold-out", 0.3],
    ["--hold-out", 0.4, "--blocks", "--range-max", 6],
    ["--set", "sensor.fade=0.5", "--set", "sensor.hit_width=0.2", "--votes", "beam"],
    ["--set", "map.path_lengths=true", "--votes", "beam"],
    ["--set", "map.half_life=20", "--set", "map.t_ref_ns=2000000000000000000"],
    ["--set", "sensor.body_min=[-0.3, -0.2]", "--set", "sensor.body_max=[0.3, 0.2]"],
    ["--sensor", "sonar", "--set", "sensor.cone_deg=5", "--range-max", 8],
]


@pytest.mark.parametrize("words", WAYS, ids=lambda words: " ".join(map(str, words)) or "plain")
def test_both_without_one_is_the_other(
    words: list[object], run: Run, logs: list[Path], tmp_path: Path
) -> None:
    if "map.half_life=20" in words:
        stamps = [scan.stamp_ns or 0 for path in logs for scan in oddsmap.open_log(path)]
        words = [*words[:-1], f"map.t_ref_ns={max(stamps)}"]
    words = ["--resolution", 0.1, *words]
    a, both = built(run, tmp_path / "a.zarr", logs[0], *words), tmp_path / "both.zarr"
    built(run, both, *logs[:2], *words)
    done = run("subtract", both, logs[1], "-o", tmp_path / "rest.zarr")
    assert (done.status, done.err) == (0, "")
    assert_same(tmp_path / "rest.zarr", a)
    cells = [oddsmap.load_map(path).cell_count() for path in (both, a)]
    assert f"unknown  {cells[0] - cells[1]:,} cells again\n" in done.out


def test_the_same_of_clouds(run: Run, clouds: list[Path], tmp_path: Path) -> None:
    a = built(run, tmp_path / "a.zarr", clouds[0], "--resolution", 0.2)
    both = built(run, tmp_path / "both.zarr", *clouds, "--resolution", 0.2)
    done = run("subtract", both, clouds[1], "-o", tmp_path / "rest.zarr", "--json")
    assert done.json["logs"] == [{"log": str(clouds[1]), "scans": 3, "beams": 600}]
    assert_same(tmp_path / "rest.zarr", a)
    assert done.json["cells_unknown_again"] > 0
    flat = tmp_path / "flat.log"
    flat.write_text("FLASER 2 1.0 1.0 0 0 0 0 0 0 1 host 1\n" * 3)
    assert "has 2D scans, the map is 3D" in run("subtract", both, flat, "-o", tmp_path / "m").line


def test_several_logs_of_one_name(run: Run, logs: list[Path], tmp_path: Path) -> None:
    """The one that is meant is told by how many scans and beams it has."""
    whole = built(run, tmp_path / "whole.zarr", *logs, "--resolution", 0.1)
    rest = tmp_path / "rest.zarr"
    assert run("subtract", whole, logs[1], "-o", rest).status == 0
    assert_same(rest, built(run, tmp_path / "ac.zarr", logs[0], logs[2], "--resolution", 0.1))
    done = run("subtract", whole, logs[2], logs[1], "-o", rest, "--force")
    assert_same(rest, built(run, tmp_path / "a.zarr", logs[0], "--resolution", 0.1))
    assert f"\nleft     of {whole} without {logs[2]}, {logs[1]}\n" in done.out


def test_a_log_that_is_not_in_the_map(run: Run, logs: list[Path], tmp_path: Path) -> None:
    a = built(run, tmp_path / "a.zarr", logs[0], "--resolution", 0.1)
    before = folder_bytes(a)
    assert "does not hold the evidence" in run("subtract", a, logs[1], "-o", tmp_path / "m").line
    again = tmp_path / "renamed.log"
    again.write_bytes(logs[0].read_bytes())
    done = run("subtract", a, again, "-o", tmp_path / "none.zarr")
    assert done.status == 0
    assert "renamed.log is not among what the first map was made from" in done.out + done.err
    assert oddsmap.load_map(tmp_path / "none.zarr").cell_count() == 0
    assert folder_bytes(a) == before


def test_a_log_that_is_read_in_another_way(run: Run, logs: list[Path], tmp_path: Path) -> None:
    both = built(run, tmp_path / "both.zarr", *logs[:2], "--resolution", 0.1)
    lines = logs[1].read_text().splitlines(keepends=True)
    logs[1].write_text("".join(lines[1:]))
    line = run("subtract", both, logs[1], "-o", tmp_path / "m.zarr").line
    assert line.startswith(f"{both}: b.log is not read as when it was mapped: 6 scans, ")
    logs[1].write_text("no log")
    assert run("subtract", both, logs[1], "-o", tmp_path / "m.zarr").line.startswith(str(logs[1]))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (["resample", "--resolution", 0.2], "for it was resampled to larger cells"),
        (["rotate-frame", "--axes", "y -x"], "for it was turned"),
    ],
)
def test_maps_that_were_changed_as_a_whole(
    change: list[object], words: str, run: Run, logs: list[Path], tmp_path: Path
) -> None:
    a = built(run, tmp_path / "a.zarr", logs[0], "--resolution", 0.1)
    other = tmp_path / "other.zarr"
    assert run(change[0], a, *change[1:], "-o", other).status == 0
    assert words in run("subtract", other, logs[0], "-o", tmp_path / "m.zarr").line


def test_a_log_that_was_moved(run: Run, logs: list[Path], tmp_path: Path) -> None:
    a, b = (built(run, path.with_suffix(".zarr"), path, "--resolution", 0.1) for path in logs[:2])
    both = tmp_path / "both.zarr"
    assert run("merge", a, b, "--shift", "4 0", "-o", both).status == 0
    out = tmp_path / "m.zarr"
    assert "b.log was moved after it was mapped" in run("subtract", both, logs[1], "-o", out).line
    line = run("subtract", both, logs[1], "--shift", "4 0", "-o", out).line
    assert "--transform and --shift move saved maps" in line


def test_a_log_that_was_mapped_in_two_ways(run: Run, logs: list[Path], tmp_path: Path) -> None:
    maps = [
        built(run, tmp_path / f"{n}.zarr", logs[0], "--resolution", 0.1, "--hold-out", n)
        for n in (0.2, 0.5)
    ]
    assert run("merge", *maps, "-o", tmp_path / "sum.zarr").status == 0
    line = run("subtract", tmp_path / "sum.zarr", logs[0], "-o", tmp_path / "m.zarr").line
    assert "logs of the name a.log were mapped in several ways" in line


def test_options_of_logs_need_one(run: Run, logs: list[Path], tmp_path: Path) -> None:
    a = built(run, tmp_path / "a.zarr", logs[0], "--resolution", 0.1)
    b = built(run, tmp_path / "b.zarr", logs[1], "--resolution", 0.1)
    out = tmp_path / "m.zarr"
    assert "need a log" in run("subtract", a, b, "--skip-bad", "-o", out).line
    assert "gone.log: no such file" in run("subtract", a, tmp_path / "gone.log", "-o", out).line
    assert json.loads(run("subtract", a, a.parent / "a.log", "-o", out, "--json").out)["logs"]
