# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build --memory`: the same map, with parts of it on the disk meanwhile."""

from __future__ import annotations

from pathlib import Path

import pytest

from oddsmap import limits
from tests.cli.conftest import Run
from tests.scale.test_budgeted_map import content


def test_the_same_map(
    run: Run, office: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("build", office, office, "--resolution", 0.05, "--hold-out", 0.1)
    plain = run(*words, "-o", tmp_path / "a.zarr", "--json").json
    monkeypatch.setattr(limits, "_LEAST_BUDGET", 1)
    small = run(*words, "-o", tmp_path / "b.zarr", "--memory", "200kB", "--json").json
    assert content(tmp_path / "a.zarr") == content(tmp_path / "b.zarr")
    assert "spilled" not in plain
    assert small["spilled"]["times"] > 0
    assert small["spilled"]["bytes"] > 0
    same = ("scans", "beams", "hits", "passes", "cells_known", "own_votes_predicted", "skipped")
    assert {name: plain[name] for name in same} == {name: small[name] for name in same}
    said = run(*words, "-o", tmp_path / "c.zarr", "--memory", "200kB").out
    assert "partial sums were kept on the disk meanwhile" in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.zarr", "b.zarr", "c.zarr"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--memory", "lots"), "memory is a number with its unit, as 4GB or 500MB"),
        (("--memory", "4"), "memory is a number with its unit"),
        (("--memory", "1MB"), "memory: at least 32MB are needed, got '1MB'"),
        (("--memory", "1GB", "--auto"), "--memory belongs to --estimator filter alone: --auto"),
        (("--memory", "1GB", "--estimator", "full-map"), "a full map is kept whole"),
    ],
)
def test_what_is_refused(
    run: Run, office: Path, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    done = run("build", office, "--resolution", 0.1, "-o", tmp_path / "a.zarr", *words)
    assert done.status == 1
    assert message in done.line
    assert list(tmp_path.iterdir()) == []
