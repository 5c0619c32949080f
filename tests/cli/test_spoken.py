# SPDX-License-Identifier: Apache-2.0
"""Messages of the library at the command line: options alone."""

from __future__ import annotations

from pathlib import Path

import pytest

import oddsmap
from oddsmap.cli.spoken import at_command_line
from tests.cli.conftest import Run


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ("a: has come; use force=True to replace it", "a: has come; use --force to replace it"),
        ("read the rest with --skip-bad (skip_bad=True)", "read the rest with --skip-bad"),
        ("--poses FILE (poses=), or --origin X Y Z (origin=).", "--poses FILE, or --origin X Y Z."),
        ("state it with --camera 'FX FY' (camera=)", "state it with --camera 'FX FY'"),
        ("with --clock-offset SECONDS (clock_offset_s=)", "with --clock-offset SECONDS"),
        ("--depth-scale 1000 (depth_scale=1000)", "--depth-scale 1000"),
        ("one by one (--scans TOPIC, scans=)", "one by one (--scans TOPIC)"),
        ("leave points_in (--points-in) out", "leave --points-in out"),
        ("no option here (sigma=0.1), leave it", "no option here (sigma=0.1), leave it"),
        ("--poses FILE (x=1)", "--poses FILE (x=1)"),
    ],
)  # fmt: skip
def test_what_is_typed_is_what_is_said(message: str, said: str) -> None:
    assert at_command_line(message) == said


def test_the_same_error_in_python_and_at_the_command_line(run: Run, tmp_path: Path) -> None:
    grid = oddsmap.EvidenceMap(0.1)
    grid.add(oddsmap.Scan.from_angles((0, 0, 0), [0.0], [1.0]))
    grid.save(tmp_path / "m.zarr")
    with pytest.raises(oddsmap.OutputError, match=r"exists already; use force=True to replace it$"):
        grid.save(tmp_path / "m.zarr")
    line = run("resample", tmp_path / "m.zarr", "--resolution", 0.2, "-o", tmp_path / "m.zarr").line
    assert "is the input" in line
    (tmp_path / "n.png").touch()
    line = run("export", tmp_path / "m.zarr", tmp_path / "n.png").line
    assert line.endswith("exists already; use --force to replace it")
