# SPDX-License-Identifier: Apache-2.0
"""The page on data of one's own: its blocks run as they stand, and wrong calls say what it says."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import pytest

import oddsmap

PAGE = Path(__file__).resolve().parents[1] / "docs" / "your-own-data.md"


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The names that the blocks of the page leave, each run after those before it."""
    names: dict[str, Any] = {"__name__": "__main__"}
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    assert len(blocks) >= 10
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("error")
        patch.chdir(tmp_path_factory.mktemp("page"))
        for block in blocks:
            exec(compile(block, PAGE.name, "exec"), names)
        assert {path.name for path in Path().iterdir()} >= {"first.yaml", "first.png", "cloud.zarr"}
    return names


def test_the_blocks_do_what_the_page_says(ran: dict[str, Any]) -> None:
    assert (ran["report"].scans, ran["report"].beams) == (1, 181)
    assert ran["pose"].translation.tolist() == [0.25, 0.0, 0.0]
    assert isinstance(ran["grid"].sensor, oddsmap.ConeSensor)
    assert ran["grid"].report is None or ran["grid"].report.scans == 2
    turned = ran["turned"]
    assert turned.map_from_sensor.transform(turned.measured_points).tolist() == [[4.0, 2.0, 0.3]]
    seconds = 1_700_000_000
    assert len(ran["in_space"]) == 5
    assert ran["datetime"](2023, 11, 14, 22, 13, 20, tzinfo=ran["UTC"]).timestamp() == seconds


WRONG = re.findall(r"^\| `(.+)` \| (.+) \|$", PAGE.read_text(encoding="utf-8"), re.M)


def test_this_test_sees_the_table() -> None:
    assert len(WRONG) >= 20


@pytest.mark.parametrize(("call", "says"), WRONG)
def test_wrong_calls_say_what_the_page_says(call: str, says: str, ran: dict[str, Any]) -> None:
    names = {**ran, "grid": oddsmap.EvidenceMap(0.1)}
    with pytest.raises(oddsmap.OddsmapError, match=re.escape(says)) as refusal:
        exec(compile(call, PAGE.name, "exec"), names)
    assert isinstance(refusal.value, ValueError)
    assert names["grid"].bounds() is None
    assert "\n" not in str(refusal.value)
