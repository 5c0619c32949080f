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


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    def run_it(*words: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["oddsmap", *map(str, words)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            main()
        code = end.value.code
        said = capsys.readouterr()
        return Outcome(code if isinstance(code, int) else 0, said.out, said.err)

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
