# SPDX-License-Identifier: Apache-2.0
"""Run the command line in this process."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from oddsmap.cli import main


@dataclass
class Outcome:
    status: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        facts = json.loads(self.out)
        assert isinstance(facts, dict)
        return facts

    @property
    def line(self) -> str:
        """The one line of a failure: no traceback, nothing on stdout, exit status 1."""
        assert self.status == 1, (self.status, self.err)
        assert self.out == ""
        assert self.err.startswith("oddsmap: ")
        assert self.err.count("\n") == 1
        return self.err.removeprefix("oddsmap: ").strip()


Run = Callable[..., Outcome]


def folder_bytes(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    def run_it(*words: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["oddsmap", *map(str, words)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            main()
        code = end.value.code
        printed = capsys.readouterr()
        return Outcome(code if isinstance(code, int) else 0, printed.out, printed.err)

    return run_it


@pytest.fixture(scope="session")
def office(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small log: 20 scans of the simulated office, with no-returns."""
    import numpy as np

    from oddsmap.simulate import Lidar2D, office_drive, office_plan, write_carmen

    rng, plan = np.random.default_rng(1), office_plan()
    lidar = Lidar2D(p_dropout=0.05)
    path = tmp_path_factory.mktemp("logs") / "office.log.gz"
    write_carmen(path, [lidar.scan(plan, pose, rng) for pose in office_drive(20)])
    return path


@pytest.fixture
def tilted_floor(tmp_path: Path) -> Path:
    """A 3D map: a floor of 4 x 4 m tilted by 10 %, a post on it, free space above."""
    import numpy as np

    import oddsmap

    grid = oddsmap.EvidenceMap(0.1, ndim=3)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(40), np.arange(40)))
    floor = x // 10
    post = np.array([[30, 5, 3 + k] for k in range(1, 10)])
    free = np.stack([x, y, floor + 5], axis=1)
    free = free[(free[:, 0] != 30) | (free[:, 1] != 5)]
    hits = np.concatenate([np.stack([x, y, floor], axis=1), post])
    none = np.zeros(len(hits), np.int64)
    grid.add_cells(hits, none + 6 * 65536, none)
    grid.add_cells(free, none[:1].repeat(len(free)), np.full(len(free), 6 * 65536))
    grid.save(tmp_path / "space.zarr")
    return tmp_path / "space.zarr"


@pytest.fixture(scope="session")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """2D maps, one of another resolution and one of scan votes, and 3D maps."""
    import numpy as np

    import oddsmap

    folder = tmp_path_factory.mktemp("maps")
    rng = np.random.default_rng(5)
    for name, resolution, votes, ndim in (
        ("hall", 0.1, "beam", 2), ("old", 0.1, "beam", 2), ("coarse", 0.3, "beam", 2),
        ("scans", 0.1, "scan", 2), ("space", 0.1, "beam", 3), ("before", 0.1, "beam", 3),
    ):  # fmt: skip
        grid = oddsmap.EvidenceMap(resolution, votes=votes, ndim=ndim)
        reach = 10 if ndim == 2 else 3
        index = np.unique(rng.integers(-reach, reach + 2, (150, ndim)), axis=0)
        grid.add_cells(index, *(rng.integers(0, 9, (2, len(index))) * 65536))
        grid.save(folder / f"{name}.zarr")
    oddsmap.load_map(folder / "old.zarr").log_odds().save_ros(folder / "old.yaml", mode="scale")
    before = oddsmap.load_map(folder / "before.zarr").log_odds()
    before.save_octomap(folder / "before.ot")
    before.save_octomap(folder / "before.bt")
    (folder / "notes.txt").write_text("no map")
    return folder
