# SPDX-License-Identifier: Apache-2.0
"""`build_saved_map` against `build_map` and `save`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import ConfigError, InputError, OutputError, limits
from tests import memory_kit
from tests.scale.test_budgeted_map import content


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"votes": "beam", "path_lengths": True, "threads": 2},
        {"half_life": 5.0},
        {"half_life_scans": 9.0},
    ],
)
def test_as_build_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any]
) -> None:
    monkeypatch.setattr(limits, "_LEAST_BUDGET", 1)
    whole = oddsmap.build_map(memory_kit.lidar(), 0.1, **options)
    whole.save(tmp_path / "a.zarr")
    seen: list[int] = []
    saved = oddsmap.build_saved_map(
        iter(memory_kit.lidar()), 0.1, str(tmp_path / "b.zarr"), memory=1, progress=seen.append,
        **options,
    )  # fmt: skip
    assert content(tmp_path / "b.zarr") == content(tmp_path / "a.zarr")
    assert isinstance(saved, oddsmap.SavedMap)
    assert saved.report is not None
    assert saved.report.scans == seen[-1] == 60
    points = np.array([[3.0, 3.0], [5.0, 7.0]])
    assert np.array_equal(saved.at(points), whole.log_odds().at(points))


@pytest.mark.parametrize("memory", [None, "1GB"])
def test_a_map_that_fits(tmp_path: Path, memory: str | None) -> None:
    path = tmp_path / "a.zarr"
    oddsmap.build_saved_map(memory_kit.turns(), 0.2, path, memory=memory)
    oddsmap.build_map(memory_kit.turns(), 0.2).save(tmp_path / "b.zarr")
    assert content(path) == content(tmp_path / "b.zarr")
    with pytest.raises(OutputError, match="exists"):
        oddsmap.build_saved_map(memory_kit.turns(), 0.2, path)
    oddsmap.build_saved_map(memory_kit.turns(), 0.4, path, force=True)
    assert oddsmap.EvidenceMap.open(path).resolution == 0.4


def test_what_is_refused(tmp_path: Path) -> None:
    for memory, says in ((5, "at least 32MB are needed, got 5"), ("4 parsecs", "as 4GB or 500MB")):
        with pytest.raises(ConfigError, match=says):
            oddsmap.build_saved_map([], 0.1, tmp_path / "a.zarr", memory=memory)
    with pytest.raises(InputError, match="no usable scan"):
        oddsmap.build_saved_map([], 0.1, tmp_path / "a.zarr")
    assert list(tmp_path.iterdir()) == []
