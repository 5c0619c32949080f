# SPDX-License-Identifier: Apache-2.0
"""The page on maps larger than memory: its blocks and commands run as they stand."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import matplotlib
import pytest

from tests.cli.conftest import Run, run

__all__ = ["run"]

PAGE = Path(__file__).resolve().parents[1] / "docs" / "scale.md"


def test_the_page(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    matplotlib.use("agg")
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text(encoding="utf-8")
    names = {"__name__": "__main__"}
    for block in re.findall(r"^```python\n(.*?)^```$", text, re.S | re.M):
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
