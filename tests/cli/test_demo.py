# SPDX-License-Identifier: Apache-2.0
"""`oddsmap demo`."""

from __future__ import annotations

from pathlib import Path

import oddsmap
from tests.cli.conftest import Run


def test_demo(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    done = run("demo", "-o", folder)
    assert done.status == 0
    assert {path.suffix for path in folder.iterdir()} == {".gz", ".zarr", ".yaml", ".pgm", ".png"}
    assert oddsmap.load_map(folder / "office.zarr").cell_count() > 50_000
    assert "exists already" in run("demo", "-o", folder).line
