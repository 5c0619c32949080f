# SPDX-License-Identifier: Apache-2.0
"""Scans and transforms that were stamped by clocks that differ."""

from __future__ import annotations

from pathlib import Path

import pytest

from oddsmap.readers import open_log
from tests.recordings.bags import Messages, Said
from tests.recordings.test_recorded_log import SECOND, START


def run(messages: Messages, ahead_s: float) -> list[Said]:
    """A drive of 6 s whose transforms come at once, and scans with another clock."""
    fixed = messages.transform(START, "base", "laser", (0.2, 0.0, 0.3), 0.0)
    said: list[Said] = [("/tf_static", START, messages.tf(fixed))]
    for k in range(60):
        now = START + k * SECOND // 10
        moved = messages.transform(now, "odom", "base", (0.05 * k, 0.0, 0.0), 0.0)
        said.append(("/tf", now, messages.tf(moved)))
        stamp = now + round(ahead_s * SECOND)
        said.append(("/scan", now + SECOND // 20, messages.laser(stamp, "laser", [2.0] * 9)))
    return said


@pytest.mark.parametrize(
    ("ahead_s", "offset"), [(0.0, None), (0.3, None), (2.0, "-1.95"), (-1.5, "1.55")]
)
def test_clocks_that_differ_are_named(ahead_s: float, offset: str | None, tmp_path: Path) -> None:
    messages = Messages("mcap")
    path = messages.write(tmp_path / "run", run(messages, ahead_s))
    said = [note for note in open_log(path).notes if note.code == "clock.header"]
    if offset is None:
        assert said == []
    else:
        assert len(said) == 1
        assert said[0].endswith(f"--clock-offset {offset}")
        # Who says so is not told again.
        log = open_log(path, clock_offset_s=float(offset))
        assert "clock.header" not in [note.code for note in log.notes]
