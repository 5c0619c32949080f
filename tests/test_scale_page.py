# SPDX-License-Identifier: Apache-2.0
"""The page on scale: its blocks and commands run as they stand, workers as threads."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import matplotlib
import pytest

from tests.cli.conftest import Run, run
from tests.scale.conftest import clouds as clouds  # fixtures
from tests.scale.conftest import threads_of_dask as threads_of_dask

__all__ = ["run"]

# What a block that needs workers calls.
ON_CLUSTER = "scale.build("

PAGE = Path(__file__).resolve().parents[1] / "docs" / "scale.md"


def test_the_page(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    matplotlib.use("agg")
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text(encoding="utf-8")
    names = {"__name__": "__main__"}
    for block in re.findall(r"^```python\n(.*?)^```$", text, re.S | re.M):
        if ON_CLUSTER in block:
            continue
        exec(compile(block, PAGE.name, "exec"), names)
    said = capsys.readouterr().out
    assert "<SavedMap town.zarr, 2D, cells of 0.05 m, x " in said
    for block in re.findall(r"^```sh\n(.*?)^```$", text, re.S | re.M):
        for line in block.splitlines():
            if "# not run here" in line:
                continue
            done = run(*shlex.split(line, comments=True)[1:])
            assert done.status == 0, done.err
    assert Path("room.yaml").exists()


def test_the_block_prints_what_it_should(
    clouds: Path,
    threads_of_dask: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from oddsmap.scale import reaching

    shutil.copytree(clouds, tmp_path / "clouds")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(reaching, "_local", lambda workers: _Kept(threads_of_dask))
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    (block,) = (each for each in blocks if ON_CLUSTER in each)
    exec(compile(block, PAGE.name, "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out == "10 scans in 5 chunks\nTrue\n"


class _Kept:
    """A client that others close."""

    cluster = None

    def __init__(self, client: Any) -> None:
        self._client = client

    def __getattr__(self, name: str) -> Any:
        return getattr(self._client, name)

    def close(self, timeout: float = 0.0) -> None:
        """Left to its owner."""
