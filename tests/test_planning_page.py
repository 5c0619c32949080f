# SPDX-License-Identifier: Apache-2.0
"""The page on distances and costs: its blocks run as they stand, and its picture is drawn."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"


def test_the_blocks_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (DOCS / "planning.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```$", text, re.S | re.M)
    assert len(blocks) == 6
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks:
        exec(compile(block, "planning.md", "exec"), names)
    assert {path.name for path in Path().iterdir()} == {"costs.yaml", "costs.pgm"}
    assert names["layer"][20, 30:36].tolist() == [254, 253, 253, 253, 253, 152]
    assert np.isfinite(names["field"].at([[3.0, 7.0], [4.0, 7.0]])).all()


def test_the_picture() -> None:
    spec = importlib.util.spec_from_file_location(
        "figures_planning", DOCS / "figures" / "planning.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    figure = module.draw(module.view(scans=8))
    assert len(figure.axes) == 4
    assert all(axes.has_data() for axes in figure.axes)
