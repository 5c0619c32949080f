# SPDX-License-Identifier: Apache-2.0
"""The page on moving worlds: its blocks run as they stand, and its picture shows what it says."""

from __future__ import annotations

import importlib.util
import re
import sys
import warnings
from pathlib import Path
from typing import Any

import pytest

import oddsmap

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = DOCS / "moving-worlds.md"


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The names that the blocks of the page leave, each run after those before it."""
    names: dict[str, Any] = {"__name__": "__main__"}
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    assert len(blocks) >= 3
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("error")
        patch.chdir(tmp_path_factory.mktemp("page"))
        for block in blocks:
            exec(compile(block, PAGE.name, "exec"), names)
    return names


def test_the_walker_is_found(ran: dict[str, Any]) -> None:
    assert ran["clean"].provenance[-1]["cleaned_cells"] > 50
    assert ran["cleaner"].dynamic_at([[0.05, 2.1, 1.0]]).all()


def test_the_door_is_open(ran: dict[str, Any]) -> None:
    (shut,) = ran["remembers"].log_odds().states_at(ran["door"]).state
    (opened,) = ran["forgets"].log_odds().states_at(ran["door"]).state
    assert (shut, opened) == (oddsmap.State.OCCUPIED, oddsmap.State.FREE)


def test_the_picture() -> None:
    path = DOCS / "figures" / "moving_worlds.py"
    spec = importlib.util.spec_from_file_location("figures_moving_worlds", path)
    assert spec is not None
    assert spec.loader is not None
    module: Any = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    seen = module.points(scan_count=12, columns=96)
    assert seen.dynamic[seen.moves].mean() > 0.8
    assert seen.dynamic[~seen.moves].mean() < 0.05
    assert len(module.draw(seen).axes) == 2
