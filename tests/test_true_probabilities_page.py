# SPDX-License-Identifier: Apache-2.0
"""The page on true probabilities runs as it stands, and its picture is drawn."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap.scoring.reflection import Predictions
from tests.test_figures import script

PAGE = Path(__file__).resolve().parents[1] / "docs" / "true-probabilities.md"


def test_the_blocks_do_what_the_page_says() -> None:
    names: dict[str, Any] = {}
    block = "".join(
        re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        exec(compile(block, PAGE.name, "exec"), names)
    free, wall = names["view"].at(names["places"])
    assert free < 0.01
    assert wall > 0.9
    free, wall = names["view"].reflectivity.at(names["places"])
    assert free < 0.01
    assert wall > 0.3
    free, wall = names["around"].at(names["places"])
    assert free < 0.01
    assert wall > 0.9


def test_the_picture_of_two_logs() -> None:
    rng = np.random.default_rng(0)
    q = rng.random(3000) ** 3
    hits = rng.binomial(100, q).astype(float)
    ways = {"log odds": q**2, "OctoMap's clamps": np.clip(q, 0.12, 0.97), "calibrated": q}
    found = Predictions(hits, 100.0 - hits, ways, 0.0)
    module = script("true_probabilities")
    figure = module.draw([("a", found), ("b", found)])
    assert [panel.get_title() for panel in figure.axes] == ["a", "b"]
    predicted, happened, votes = module.points(q, found)
    assert votes.sum() > 200_000
    assert predicted == pytest.approx(happened, abs=0.02)
