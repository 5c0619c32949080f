# SPDX-License-Identifier: Apache-2.0
"""The page on combining maps: its block prints what it says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[1] / "docs" / "combining.md"


def test_the_block_prints_what_the_page_says(capsys: pytest.CaptureFixture[str]) -> None:
    text = PAGE.read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```$", text, re.S | re.M)
    exec(compile(block, PAGE.name, "exec"), {"__name__": "__main__"})
    cost, walls = capsys.readouterr().out.splitlines()
    moved, mapped, there, back = map(float, walls.split())
    said = " ".join(text.split())
    found = [int(number) for number in re.findall(r": ([0-9]+)", cost)]
    cells, repeated, dropped, before, after = found
    share = f"{100 * repeated / cells:.0f} % each"
    assert f"of {cells} cells {repeated} are repeated and {dropped} dropped ({share})" in said
    assert f"{before} votes became {after}." in said
    assert f"{moved:.0f} occupied cells, and {mapped:.0f} in the map of the moved poses" in said
    assert f"{100 * there:.1f} % of the latter" in said
    assert f"{100 * back:.1f} % of the former" in said
