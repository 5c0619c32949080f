# SPDX-License-Identifier: Apache-2.0
"""`oddsmap history`: what was added is a commit, and every state can be written."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from oddsmap import EvidenceMap, load_map
from tests.cli.conftest import Run
from tests.kit import ONE, Votes, add_votes, votes_of

A: Votes = {(0, 0): (ONE, 0), (1, 0): (0, 3 * ONE)}
B: Votes = {(0, 0): (ONE, ONE), (5000, 0): (ONE, 0)}


def test_a_log_is_committed(
    office: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("icechunk", reason='needs pip install "oddsmap[icechunk]"')
    monkeypatch.chdir(tmp_path)
    lines = gzip.decompress(office.read_bytes()).decode().splitlines(keepends=True)
    scans = [line for line in lines if line.startswith("FLASER")]
    for name, part in (("a.log", scans[:5]), ("b.log", scans[5:10])):
        Path(name).write_text("".join(part))
    run("build", "a.log", "--resolution", "0.2", "-o", "a.zarr")
    run("build", "a.log", "b.log", "--resolution", "0.2", "-o", "both.zarr")
    words = ("build", "b.log", "-o", "kept.icechunk", "--append")
    assert run(*words).line == "kept.icechunk: no such folder: add a map first"
    assert "--append" in run("build", "b.log", "--resolution", "1", "-o", "kept.icechunk").line
    run("history", "kept.icechunk", "--add", "a.zarr")
    assert "map.resolution is 0.1 here" in run(*words, "--resolution", "0.1").line
    said = run(*words)
    assert said.status == 0, said.err
    commit = EvidenceMap.history("kept.icechunk").commit()
    assert f"commit   {commit.id} (oddsmap history kept.icechunk)" in said.out
    assert (commit.done, commit.sources) == ("added", ["b.log"])
    kept, both = EvidenceMap.history("kept.icechunk").load(), load_map("both.zarr")
    assert votes_of(kept) == votes_of(both)
    assert run(*words, "--json").json["commit"] == EvidenceMap.history("kept.icechunk").commit().id


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, votes in (("a", A), ("b", B)):
        grid = EvidenceMap(0.5)
        add_votes(grid, votes)
        grid.record(f"{name}.log", scans=len(votes))
        grid.save(f"{name}.zarr")
    return tmp_path


def test_options_that_do_not_go_together(folder: Path, run: Run) -> None:
    for words, said in (
        (("--add", "a.zarr", "-o", "out.zarr"), "one step each"),
        (("--at", "2026-11-24"), "give -o"),
        (("-m", "why"), "--add or --subtract"),
        (("--add", "no.zarr"), "no.zarr: no such file"),
    ):
        assert said in run("history", "m.icechunk", *words).line
    assert not Path("m.icechunk").exists()


def test_there_and_back(folder: Path, run: Run) -> None:
    pytest.importorskip("icechunk", reason='needs pip install "oddsmap[icechunk]"')
    first = run("history", "m.icechunk", "--add", "a.zarr", "-m", "first  drive")
    assert first.status == 0, first.err
    assert first.out.rstrip().endswith("Z  first drive")
    second = run("history", "m.icechunk", "--add", "b.zarr", "--json").json
    assert (second["done"], second["sources"]) == ("added", ["b.log"])
    assert "a.log" in run("history", "m.icechunk", "--add", "a.zarr").out, "it counts twice"
    run("history", "m.icechunk", "--subtract", "a.zarr", "-q")
    listed = run("history", "m.icechunk")
    assert [line[20:22] + line[44:] for line in listed.out.splitlines()] == [
        "  subtracted a.log", "  added a.log", "  added b.log", "  first drive"
    ]  # fmt: skip
    assert len(run("history", "m.icechunk", "--json").json["commits"]) == 4
    run("history", "m.icechunk", "--at", first.out[:8], "-o", "then.zarr")
    run("history", "m.icechunk", "-o", "now.zarr")
    a, b = load_map("a.zarr"), load_map("b.zarr")
    assert votes_of(load_map("then.zarr")) == A
    assert votes_of(load_map("now.zarr")) == votes_of(a + b)
    assert load_map("now.zarr").provenance == (b + a).provenance
    for words in (("info",), ("view",), ("merge", "-o", "x.zarr", "a.zarr")):
        assert "oddsmap history m.icechunk -o" in run(*words, "m.icechunk").line
    assert "exists" in run("history", "m.icechunk", "-o", "now.zarr").line
    run("history", "m.icechunk", "--at", second["time"], "-o", "now.zarr", "--force")
    again = run("history", "m.icechunk", "--subtract", "b.zarr")
    assert again.status == 0
    said = run("history", "m.icechunk", "--subtract", "b.zarr").line
    assert said.startswith("b.zarr and m.icechunk: the map does not hold the evidence")
