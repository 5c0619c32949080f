# SPDX-License-Identifier: Apache-2.0
"""A map of more files than it could list is refused, and leaves nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from oddsmap import EvidenceMap, OutputError, load_map
from oddsmap.map_files import zarr_folder


def test_more_files_than_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grid, out = EvidenceMap(1.0), tmp_path / "m.zarr"
    grid.add_cells([[0, 0]], [65536], [0])  # type: ignore[arg-type]
    grid.save(out)
    monkeypatch.setattr(zarr_folder, "_MAX_JSON", (out / "zarr.json").stat().st_size - 1)
    with pytest.raises(OutputError, match=r"n\.zarr: 1 files of cells are more than a map lists"):
        grid.save(tmp_path / "n.zarr")
    monkeypatch.undo()
    assert load_map(out).cell_count() == 1
    assert [path.name for path in tmp_path.iterdir()] == ["m.zarr"]
