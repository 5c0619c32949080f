# SPDX-License-Identifier: Apache-2.0
"""`oddsmap why`: words, numbers and refusals."""

from __future__ import annotations

import gzip
import math
import re
from pathlib import Path

import numpy as np
import pytest

import oddsmap
from tests.cli.conftest import Run

PAGE = Path(__file__).resolve().parents[2] / "docs" / "why.md"


@pytest.fixture
def grid(run: Run, office: Path, tmp_path: Path) -> Path:
    out = tmp_path / "office.zarr"
    assert run("build", office, "--resolution", 0.1, "--hold-out", 0.2, "-o", out).status == 0
    return out


def busiest(path: Path) -> tuple[float, float]:
    grid = oddsmap.load_map(path)
    index, hits, _ = grid.cells()
    x, y = grid.centre_of(index[[np.argmax(hits)]])[0]
    return float(x), float(y)


def test_words_and_numbers(run: Run, grid: Path, office: Path) -> None:
    point = busiest(grid)
    facts = run("why", grid, office, *point, "--json").json
    there = oddsmap.load_map(grid).log_odds().states_at([point])
    assert there.hits is not None
    assert facts["complete"]
    assert facts["looked_at"] == 16
    assert facts["hits"] == facts["map_hits"] == there.hits[0] > 1
    assert facts["probability"] == there.probability[0]
    assert facts["state"] == "occupied"
    assert sum(vote["hits"] for vote in facts["scans"]) == facts["hits"]
    scans = list(oddsmap.open_log(office))
    for vote in facts["scans"]:
        scan = scans[vote["index"]]
        assert vote["stamp_ns"] == scan.stamp_ns
        assert (vote["index"] + 1) % 5, "a scan held out has no vote"
        told = [r if math.isfinite(r) else None for r in scan.ranges[vote["beams"]].tolist()]
        assert vote["ranges"] == told
    done = run("why", grid, office, *point)
    assert (done.status, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[0].startswith("cell      ")
    assert lines[1].startswith(f"map       {facts['hits']:g} hits")
    assert f"{len(facts['scans'])} of 16 scans voted" in lines[2]
    assert len(lines) == 4 + len(facts["scans"])
    assert re.search(r"\d+ hit \d", done.out)


def test_numbers_below_zero_are_no_options(run: Run, grid: Path, office: Path) -> None:
    done = run("why", grid, office, -100, "-3e1")
    assert done.status == 0
    assert "0 of 16 scans voted: 0 hits, 0 passes\n" in done.out
    assert "unknown" in done.out


def test_another_log(run: Run, grid: Path, office: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.log"
    other.write_bytes(2 * gzip.decompress(office.read_bytes()))
    done = run("why", grid, other, *busiest(grid))
    assert done.status == 0
    assert "which is not what the map has" in done.out
    assert f"made of {office.name}, not of this log" in done.err
    assert done.err.startswith(f"{other}: warning: the scans add up to")
    assert run("why", grid, other, *busiest(grid), "--json").json["complete"] is False


@pytest.mark.parametrize(
    ("point", "says"),
    [
        (("1",), "a point is X Y"),
        (("1", "2", "3", "4"), "a point is X Y"),
        (("1", "--verbos"), "got 1 --verbos; oddsmap why -h lists the options"),
        (("1", "nan"), "a point is X Y"),
        (("1", "2", "3"), "is a 2D map, whose points have 2 numbers"),
    ],
)
def test_what_is_refused(
    run: Run, grid: Path, office: Path, point: tuple[str, ...], says: str
) -> None:
    assert says in run("why", grid, office, *point).line


def test_a_map_is_no_log(run: Run, grid: Path) -> None:
    assert "is a saved map, not a log" in run("why", grid, grid, 1, 2).line


def test_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    exec(compile(block, PAGE.name, "exec"), {"__name__": "__main__"})
    assert len(capsys.readouterr().out.splitlines()) == 5
