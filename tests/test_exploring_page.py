# SPDX-License-Identifier: Apache-2.0
"""The page on exploring: its blocks run as they stand."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap

PAGE = Path(__file__).resolve().parents[1] / "docs" / "exploring.md"


@pytest.fixture(scope="module")
def ran() -> dict[str, Any]:
    """The names that the blocks of the page leave, each run after those before it."""
    names: dict[str, Any] = {"__name__": "__main__"}
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    assert blocks
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for block in blocks:
            exec(compile(block, PAGE.name, "exec"), names)
    return names


def test_frontiers(ran: dict[str, Any]) -> None:
    frontiers, view = ran["frontiers"], ran["view"]
    assert len(frontiers) > 1
    assert all(each.size >= 0.5 for each in frontiers)
    goals = view.states_at([each.goal for each in frontiers])
    assert (goals.state == oddsmap.State.FREE).all()
    # By the default thresholds a single pass makes nothing free.
    assert np.less(
        sum(each.size for each in ran["grid"].log_odds().frontiers()),
        sum(each.size for each in view.frontiers()),
    )
