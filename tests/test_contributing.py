# SPDX-License-Identifier: Apache-2.0
"""What CONTRIBUTING.md says of adding a reader and a sensor: a file and a line for each."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import oddsmap

PACKAGE = Path(oddsmap.__file__).parent

READER = '''
"""Toy logs: "TOY", then x, y, heading and one range a line."""

from __future__ import annotations

import numpy as np

from oddsmap.poses.pose import Pose2
from oddsmap.readers.compression import Source
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.scans.scan import Scan

__all__ = ["matches", "open_toy"]


def matches(head: bytes) -> bool:
    return head.startswith(b"TOY")


def open_toy(source: Source) -> LoadedLog:
    rows = [[float(word) for word in line.split()] for line in source.content.splitlines()[1:]]
    ahead = np.array([[1.0, 0.0]])
    return LoadedLog(
        path=source.path,
        format="toy log",
        sensor={},
        skipped=source.initial_skipped(),
        notes=tuple(source.initial_notes()),
        scans=tuple(Scan(Pose2(*row[:3]), ahead, np.array(row[3:])) for row in rows),
    )
'''

SENSOR = '''
"""A bumper: a reading says that its end point is occupied, and nothing else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from oddsmap.scans.measurement import Measurement, ranges_of
from oddsmap.sensors.cell_votes import CellVotes

__all__ = ["BumperSensor"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BumperSensor:
    kind: ClassVar[str] = "bumper"
    names: ClassVar[tuple[str, ...]] = ("bumper",)
    default_votes: ClassVar[str] = "beam"
    evidence_from: ClassVar[Literal["rays", "cells"]] = "cells"

    p_hit: float = 0.9
    p_miss: float = 0.4

    def votes(
        self, scans: Sequence[Measurement], resolution: float
    ) -> tuple[Iterator[CellVotes], Counter[str]]:
        return self._listed(scans, resolution), Counter()

    def _listed(self, scans: Sequence[Measurement], resolution: float) -> Iterator[CellVotes]:
        for scan in ranges_of(scans):
            ends = scan.map_from_sensor.transform(scan.directions * scan.ranges[:, None])
            index = np.floor(ends / resolution).astype(np.int64)
            n = len(index)
            one, none = np.full(n, 1 << 16, np.int64), np.zeros(n, np.int64)
            yield CellVotes(np.array([0, n]), index, one, none, beams=n)
'''

LINES = {
    "readers/registry.py": (
        '    Reader("CARMEN logs"',
        '    Reader("toy logs", toy.matches, _alone("a toy log", toy.open_toy)),\n',
        "from oddsmap.readers import toy\n",
    ),
    "sensors/registry.py": (
        "SENSORS: tuple[type[Sensor], ...] = (",
        None,
        "from oddsmap.sensors.bumper import BumperSensor\n",
    ),
}


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A copy of the package with the two files and their lines."""
    copied = tmp_path / "src" / "oddsmap"
    shutil.copytree(PACKAGE, copied)
    (copied / "readers" / "toy.py").write_text(READER, encoding="utf-8")
    (copied / "sensors" / "bumper.py").write_text(SENSOR, encoding="utf-8")
    for name, (before, line, used) in LINES.items():
        path = copied / name
        text = path.read_text(encoding="utf-8")
        assert text.count(before) == 1
        new = before + "BumperSensor, " if line is None else line + before
        text = text.replace(before, new)
        text = text.replace("import annotations\n", f"import annotations\n{used}", 1)
        path.write_text(text, encoding="utf-8")
    return copied


def test_a_toy_reader_and_a_toy_sensor(package: Path, tmp_path: Path) -> None:
    (tmp_path / "run.toy").write_text("TOY\n0 0 0 1.05\n0 0 0 1.05\n2 2 0 3.05\n")
    environment = {**os.environ, "PYTHONPATH": str(package.parent)}

    def run(*arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "oddsmap", *arguments],
            capture_output=True, text=True, env=environment, cwd=tmp_path, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "toy log" in run("info", "run.toy")
    run("build", "run.toy", "--resolution", "0.1", "--sensor", "bumper", "-o", "m.zarr")
    run("export", "m.zarr", "m.npz")
    code = (
        "import numpy as np; m = np.load('m.npz')\n"
        "print(m['index'].tolist(), m['hits'].tolist(), m['passes'].tolist())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=True
    )
    assert done.stdout.split("\n")[0] == "[[10, 0], [50, 20]] [2.0, 1.0] [0.0, 0.0]"
    assert "bumper" in run("info", "m.zarr", "--json")
