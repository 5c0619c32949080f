# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build --append`: logs added to a saved map."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

import oddsmap
from tests.cli.conftest import Run, folder_bytes
from tests.kit import votes_of


@pytest.fixture
def logs(office: Path, tmp_path: Path) -> list[Path]:
    """The office in three logs."""
    lines = gzip.decompress(office.read_bytes()).decode().splitlines(keepends=True)
    scans = [line for line in lines if line.startswith("FLASER")]
    paths = [tmp_path / f"{name}.log" for name in "abc"]
    for path, first in zip(paths, (0, 1, 2), strict=True):
        path.write_text("".join(scans[first::3]))
    return paths


def assert_same(path: Path, other: Path) -> None:
    one, two = oddsmap.load_map(path), oddsmap.load_map(other)
    assert votes_of(one) == votes_of(two)
    assert (one.config, one.provenance) == (two.config, two.provenance)


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["--votes", "beam", "--set", "map.path_lengths=true"],
        ["--hold-out", 0.3, "--range-max", 9],
        ["--set", "sensor.hit_width=0.3", "--set", "posterior.prior=0.3"],
        ["--sensor", "sonar", "--set", "sensor.cone_deg=5", "--range-max", 8],
    ],
    ids=str,
)
def test_it_is_what_building_both_makes(
    words: list[object], run: Run, logs: list[Path], tmp_path: Path
) -> None:
    path, whole = tmp_path / "map.zarr", tmp_path / "whole.zarr"
    assert run("build", logs[0], "--resolution", 0.1, *words, "-o", path).status == 0
    done = run("build", *logs[1:], *words, "-o", path, "--append", "--json")
    assert done.status == 0, done.err
    assert run("build", *logs, "--resolution", 0.1, *words, "-o", whole).status == 0
    assert_same(path, whole)
    before = oddsmap.build_map(oddsmap.open_log(logs[0]), 0.1) if not words else None
    if before is not None:
        cells = oddsmap.load_map(whole).cell_count()
        assert done.json["append_cells_new"] == cells - before.cell_count()
    made_from = run("info", path, "--json").json["made from"]
    assert [entry["source"] for entry in made_from] == ["a.log", "b.log", "c.log"]


def test_the_settings_of_the_map_stand(run: Run, logs: list[Path], tmp_path: Path) -> None:
    """What is not said again is the map's, and what differs is said."""
    path, whole = tmp_path / "map.zarr", tmp_path / "whole.zarr"
    words = ["--votes", "beam", "--set", "sensor.hit_width=0.3"]
    assert run("build", logs[0], "--resolution", 0.1, *words, "-o", path).status == 0
    done = run("build", logs[1], "-o", path, "--append")
    assert f"{path}: " not in done.out
    assert "\nadded    votes to " in done.out
    assert " reached, which are all\n" in done.out
    assert run("build", *logs[:2], "--resolution", 0.1, *words, "-o", whole).status == 0
    assert_same(path, whole)
    done = run("build", logs[2], "-o", path, "--append", "--range-max", 7)
    assert f"{path}: sensor.range_max is 7.0 for c.log, " in done.out
    done = run("build", logs[2], "-o", path, "--append", "--hold-out", 0.2)
    assert f"{path}: warning: c.log is in what it is added to as well" not in done.out
    done = run("build", logs[2], "-o", path, "--append")
    assert f"{path}: warning: c.log is in what it is added to as well" in done.out
    assert f"{path}: of c.log no scan is kept back" in done.out


def test_what_a_log_does_not_say(run: Run, logs: list[Path], tmp_path: Path) -> None:
    path, silent = tmp_path / "map.zarr", tmp_path / "silent.log"
    assert run("build", logs[0], "--resolution", 0.1, "-o", path).status == 0
    silent.write_text("FLASER 3 1.0 1.5 2.0 0 0 0 0 0 0 1 host 1\n")
    done = run("build", silent, "-o", path, "--append")
    assert f"{path}: silent.log says no range_max: it is mapped with the 81.83 m of" in done.out
    done = run("build", silent, "-o", path, "--append", "--range-max", 81.83)
    assert "says no range_max" not in done.out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--resolution", 0.2], "map.resolution is 0.2 here, and 0.1 in"),
        (["--votes", "beam"], "map.votes is beam here, and scan in"),
        (["--half-life-scans", 9], "map.half_life_scans is 9.0 here, and None in"),
        (["--set", "posterior.prior=0.1"], "posterior.prior is 0.1 here, and 0.5 in"),
        (["--sensor", "sonar", "--set", "sensor.cone_deg=5"], "by a sensor of kind cone, the map"),
        (["--force"], "--force replaces the map that --append adds to"),
        (["--auto"], "--auto fits the sensor to all logs"),
        (["--estimator", "full-map"], "--estimator full-map makes maps that do not add up"),
    ],
    ids=str,
)
def test_what_does_not_go_together(
    words: list[object], message: str, run: Run, logs: list[Path], tmp_path: Path
) -> None:
    path = tmp_path / "map.zarr"
    assert run("build", logs[0], "--resolution", 0.1, "-o", path).status == 0
    before = folder_bytes(path)
    assert message in run("build", logs[1], *words, "-o", path, "--append").line
    assert folder_bytes(path) == before


def test_what_is_no_map_to_add_to(run: Run, logs: list[Path], maps: Path, tmp_path: Path) -> None:
    other, sonar = tmp_path / "folder", tmp_path / "full.zarr"
    other.mkdir()
    for path, message in (
        (tmp_path / "gone.zarr", "there is no map to add to: make it without --append"),
        (other, "is no saved map"),
        (maps / "space.zarr", "2D scans cannot go into a 3D map"),
    ):
        assert message in run("build", logs[0], "-o", path, "--append").line
    words = ["--estimator", "full-map", "--set", "sensor.cone_deg=5", "--range-max", 5]
    done = run(
        "build", logs[0], "--sensor", "sonar", *words, "--sweeps", 1, "--resolution", 0.5,
        "-o", sonar,
    )  # fmt: skip
    assert done.status == 0, done.err
    assert "full map, which has no counts" in run("build", logs[0], "-o", sonar, "--append").line


def test_maps_that_forget(run: Run, logs: list[Path], tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    made = ["build", logs[0], "--resolution", 0.1, "-o", path, "--force"]
    stamps = [[scan.stamp_ns or 0 for scan in oddsmap.open_log(log)] for log in logs]
    assert run(*made, "--half-life-scans", 9).status == 0
    line = run("build", logs[1], "-o", path, "--append").line
    assert "fades with the numbers of scans of one log" in line
    assert (
        run(*made, "--set", "map.half_life=5", "--set", f"map.t_ref_ns={max(stamps[0])}").status
        == 0
    )
    assert "is later than the map's t_ref_ns" in run("build", logs[1], "-o", path, "--append").line
    words = ["--set", "map.half_life=5", "--set", f"map.t_ref_ns={max(map(max, stamps))}"]
    assert run(*made, *words).status == 0
    assert run("build", logs[2], "-o", path, "--append").status == 0
    whole = tmp_path / "whole.zarr"
    assert run("build", logs[0], logs[2], "--resolution", 0.1, *words, "-o", whole).status == 0
    assert_same(path, whole)
