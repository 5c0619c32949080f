# SPDX-License-Identifier: Apache-2.0
"""The page on exploring: its blocks run as they stand."""

from __future__ import annotations

import re
import sys
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


def test_gains(ran: dict[str, Any]) -> None:
    gains = ran["gains"]
    assert gains.shape == (len(ran["frontiers"]),)
    assert gains.min() > 0.0
    # In the middle of what was seen there is less to be learnt.
    here = [[pose.x, pose.y, pose.theta] for pose in ran["poses"]]
    laser = ran["laser"]
    known = ran["view"].information_gain(here, laser.directions, laser.range_max, unknown=0.05)
    assert known.max() < gains.max()


def figure() -> Any:
    from tests.test_figures import script

    return script("exploring")


def test_the_example_explores() -> None:
    """Its first steps, and the picture of them."""
    module = figure()
    example = module.example()
    steps = [*zip(range(6), example.explore(), strict=False)]
    known = [example.share_known(step.view) for _, step in steps]
    assert known[0] < 0.1
    assert known[-1] > 0.25
    assert all(len(step.way) > 1 for _, step in steps)
    plan = example.office_plan()
    assert not plan.contains(steps[-1][1].driven).any()
    nearest = [*zip(range(3), example.explore(nearest=True), strict=False)][-1][1]
    assert example.length_of(nearest.driven) > 0.0
    drawn = module.draw([step for _, step in steps])
    assert len(drawn.axes) == 4
    sys.modules.pop("explore")


@pytest.mark.slow
def test_the_example_maps_all_of_the_office() -> None:
    example = figure().example()
    *_, last = example.explore()
    assert example.share_known(last.view) > 0.99
    assert len(last.frontiers) == 0
