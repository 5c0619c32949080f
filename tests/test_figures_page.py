# SPDX-License-Identifier: Apache-2.0
"""The page on figures and notebooks: its blocks run as they stand, and its picture is drawn."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from oddsmap.cli.app import app
from tests.test_figures import DOCS, script

PAGE = (DOCS / "figures-and-notebooks.md").read_text(encoding="utf-8")


def test_the_blocks_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.S | re.M)
    assert len(blocks) == 4
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks:
        exec(compile(block, "figures-and-notebooks.md", "exec"), names)
    made = {path.name for path in Path().iterdir()}
    assert made == {"two.pdf", "two.png", "map.png", "map.pdf"}
    assert names["png"].startswith(b"\x89PNG")
    stated = re.search(r"^# (<EvidenceMap .*>)$", PAGE, re.M)
    assert stated is not None
    assert capsys.readouterr().out.splitlines()[0] == stated[1]


def test_the_picture() -> None:
    module = script("figures_and_notebooks")
    figure = module.draw(*module.office(scans=8))
    assert len(figure.axes) == 8  # each with its colour bar
    assert module.OUTPUT.exists()


def test_the_commands_know_their_options() -> None:
    """Options on the page are those of the command."""
    import typer.main

    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    known = {name for option in commands["export"].params for name in option.opts}
    used = {
        word
        for line in PAGE.splitlines()
        if line.startswith("oddsmap export")
        for word in re.findall(r"--[a-z-]+", line)
    }
    assert used
    assert used <= known
