# SPDX-License-Identifier: Apache-2.0
"""`oddsmap merge`, `subtract`, `crop` and `resample`: maps made of saved maps."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

import oddsmap
from tests.cli.conftest import Run
from tests.kit import ONE, votes_of


@pytest.fixture
def halves(office: Path, tmp_path: Path) -> tuple[Path, Path]:
    """Two logs: the scans of one, by turns."""
    lines = gzip.decompress(office.read_bytes()).decode().splitlines(keepends=True)
    scans = [line for line in lines if line.startswith("FLASER")]
    assert len(scans) == 20
    paths = tmp_path / "even.log", tmp_path / "odd.log"
    for path, first in zip(paths, (0, 1), strict=True):
        path.write_text("".join(scans[first::2]))
    return paths


def build(run: Run, out: Path, *words: object, resolution: float = 0.1) -> Path:
    assert run("build", *words, "--resolution", resolution, "-o", out).status == 0
    return out


def assert_same(path: Path, other: Path) -> None:
    """The same evidence, settings and provenance."""
    one, two = oddsmap.load_map(path), oddsmap.load_map(other)
    assert votes_of(one) == votes_of(two)
    assert (one.config, one.provenance) == (two.config, two.provenance)


def test_maps_of_parts_add_up_to_the_map_of_all(
    run: Run, halves: tuple[Path, Path], tmp_path: Path
) -> None:
    even, odd = (build(run, log.with_suffix(".zarr"), log) for log in halves)
    whole = build(run, tmp_path / "whole.zarr", *halves)
    both, rest = tmp_path / "both.zarr", tmp_path / "rest.zarr"
    done = run("merge", even, odd, "-o", both)
    assert done.status == 0
    assert done.out.startswith("merged   2 maps\nseen ")
    assert f"map      {both}" in done.out
    assert done.err == ""
    assert_same(both, whole)
    done = run("subtract", both, odd, "-o", rest)
    assert done.out.startswith(f"left     of {both} without {odd}\nunknown  ")
    assert_same(rest, even)
    assert run("merge", odd, even, "-o", tmp_path / "turned.zarr").status == 0
    turned = oddsmap.load_map(tmp_path / "turned.zarr")
    assert votes_of(turned) == votes_of(oddsmap.load_map(whole))


def test_the_summary_for_programs(run: Run, maps: Path, tmp_path: Path) -> None:
    a, b, out = maps / "hall.zarr", maps / "old.zarr", tmp_path / "m.zarr"
    facts = run("merge", a, b, "-o", out, "--json").json
    grid = oddsmap.load_map(out)
    assert facts["inputs"] == [str(a), str(b)]
    assert facts["output"] == str(out)
    assert facts["cells_known"] == grid.cell_count()
    assert facts["hits"] == grid.census().hits / ONE
    facts = run("resample", out, "--resolution", 0.3, "-o", tmp_path / "r.zarr", "--json").json
    assert (facts["resampled_from"], facts["resolution"]) == (0.1, 0.3)
    assert run("merge", a, b, "-o", out, "--force", "-q").out == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("merge", "hall.zarr"), "one map alone"),
        (("merge", "hall.zarr", "hall.zarr"), "hall.zarr: is given twice"),
        (("merge", "hall.zarr", "coarse.zarr"), "resample the finer one to 0.3 m first"),
        (("merge", "hall.zarr", "scans.zarr"), "build one again with the other's map.votes"),
        (("merge", "hall.zarr", "space.zarr"), "space.zarr and hall.zarr: maps of different ndim"),
        (("merge", "hall.zarr", "old.yaml"), "old.yaml: not a saved map"),
        (("merge", "hall.zarr", "gone.zarr"), "gone.zarr: no such file"),
        (("subtract", "hall.zarr", "old.zarr"), "does not hold the evidence"),
        (("subtract", "hall.zarr", "coarse.zarr"), "cannot be subtracted"),
        (("crop", "hall.zarr", "--box", "0 0 1"), "--box 0 0 1: four numbers"),
        (("crop", "hall.zarr", "--box", "0 0 a 1"), "four numbers"),
        (("crop", "hall.zarr", "--box", "1 0 0 1"), "the lowest corner comes first"),
        (("crop", "hall.zarr", "--box", "0 0 0 1 1 1"), "2D map, whose box has 4 numbers"),
        (("crop", "space.zarr", "--box", "0 0 1 1"), "3D map, whose box has 6 numbers"),
        (("crop", "hall.zarr", "--box", "90 90 91 91"), "no evidence in the box"),
        (("resample", "hall.zarr", "--resolution", "0.25"), "give 0.2 or 0.3"),
        (("resample", "hall.zarr", "--resolution", "0.05"), "cannot be split"),
        (("resample", "hall.zarr", "--resolution", "0.1"), "has cells of 0.1 m already"),
        (("resample", "hall.zarr", "--resolution", "-1"), "side of a cell in metres"),
    ],
)  # fmt: skip
def test_wrong_requests(
    run: Run,
    maps: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(maps)
    assert message in run(*words, "-o", tmp_path / "m.zarr").line
    assert list(tmp_path.iterdir()) == []


def test_what_is_written_is_checked_first(run: Run, maps: Path, tmp_path: Path) -> None:
    hall, old = maps / "hall.zarr", maps / "old.zarr"
    (tmp_path / "there.zarr").mkdir()
    (tmp_path / "there.zarr" / "letter.txt").write_text("mine")
    for out, message in (
        (tmp_path / "m.png", "by custom NAME.zarr"),
        (hall, "is the input"),
        (tmp_path / "there.zarr", "no map of oddsmap"),
    ):
        assert message in run("merge", hall, old, "-o", out, "--force").line
        assert message in run("crop", hall, "--box", "0 0 1 1", "-o", out, "--force").line


def test_a_box_of_a_map(run: Run, maps: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.zarr"
    for name, box, lo, hi in (
        ("hall", "-0.3 0 0.7 0.5", (-0.3, 0), (0.7, 0.5)),
        ("space", "-0.3,-0.3,0,0.2,0.2,0.2", (-0.3, -0.3, 0), (0.2, 0.2, 0.2)),
    ):
        done = run("crop", maps / f"{name}.zarr", "--box", box, "-o", out, "--force")
        assert done.status == 0, done.err
        whole = oddsmap.load_map(maps / f"{name}.zarr")
        assert votes_of(oddsmap.load_map(out)) == votes_of(whole.crop_box(lo, hi))
    assert done.out.startswith("cropped  0.5 x 0.5 x 0.2 metres\n")


def test_larger_cells(run: Run, maps: Path, tmp_path: Path) -> None:
    for name, factor in (("hall", 3), ("space", 2)):
        out = tmp_path / f"{name}.zarr"
        side = f"{0.1 * factor:g}"
        done = run("resample", maps / f"{name}.zarr", "--resolution", side, "-o", out)
        coarse, fine = oddsmap.load_map(out), oddsmap.load_map(maps / f"{name}.zarr")
        assert votes_of(coarse) == votes_of(fine.resample(float(side)))
        assert f"has the votes of {factor**fine.ndim} cells" in done.out
        assert coarse.census().hits == fine.census().hits
        assert "resampled_from 0.1" in run("info", out).out


def test_evidence_that_would_count_twice(
    run: Run, halves: tuple[Path, Path], tmp_path: Path
) -> None:
    log = halves[0]
    one = build(run, tmp_path / "one.zarr", log)
    two = build(run, tmp_path / "two.zarr", log, "--set", "sensor.range_max=5")
    done = run("merge", one, two, "-o", tmp_path / "m.zarr")
    assert done.status == 0
    assert f"{two}: warning: even.log is in what it is added to as well" in done.out
    assert "sensor.range_max is 5, and " in done.out
    assert "in the first map, whose settings stand" in done.out


def test_cells_that_weigh_differently(run: Run, maps: Path, tmp_path: Path) -> None:
    fine, out = tmp_path / "fine.zarr", tmp_path / "m.zarr"
    assert run("resample", maps / "hall.zarr", "--resolution", 0.3, "-o", fine).status == 0
    done = run("merge", maps / "coarse.zarr", fine, "-o", out)
    assert "warning: it is resampled from 0.1 m, the first map not resampled" in done.out


def test_taking_out_the_evidence_of_another_log(run: Run, tmp_path: Path) -> None:
    for name, votes in (("all", 5), ("part", 2)):
        grid = oddsmap.EvidenceMap(0.1)
        grid.add_cells(np.array([[1, 2]]), np.array([votes * ONE]), np.array([0]))
        grid.record(f"{name}.log")
        grid.save(tmp_path / f"{name}.zarr")
    whole, part, out = (tmp_path / f"{name}.zarr" for name in ("all", "part", "left"))
    done = run("subtract", whole, part, "-o", out)
    assert "warning: part.log is not among what the first map was made from" in done.out
    assert votes_of(oddsmap.load_map(out)) == {(1, 2): (3 * ONE, 0)}
    assert "subtracted" in run("info", out).out


def test_maps_of_other_sensors(run: Run, tmp_path: Path) -> None:
    for name, sensor in (("beams", None), ("cones", oddsmap.ConeSensor(cone_deg=20.0))):
        grid = oddsmap.EvidenceMap(0.1, votes="beam", sensor=sensor)
        grid.add_cells(np.array([[1, 2]]), np.array([ONE]), np.array([0]))
        grid.save(tmp_path / f"{name}.zarr")
    beams, cones, out = (tmp_path / f"{name}.zarr" for name in ("beams", "cones", "both"))
    assert "--any-sensor" in run("merge", beams, cones, "-o", out).line
    assert run("merge", beams, cones, "-o", out, "--any-sensor").status == 0
    assert "--any-sensor" in run("subtract", out, cones, "-o", tmp_path / "left.zarr").line
    done = run("subtract", out, cones, "-o", tmp_path / "left.zarr", "--any-sensor")
    assert done.status == 0
