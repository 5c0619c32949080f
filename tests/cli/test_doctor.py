# SPDX-License-Identifier: Apache-2.0
"""`oddsmap doctor`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run
from tests.plausibility.faults import office


def carmen(path: Path, *, degrees: bool) -> Path:
    """A log of a drive through an office, its headings in radians or not."""
    lines = []
    for i, scan in enumerate(office()[:80]):
        ranges = np.nan_to_num(scan.ranges, nan=81.83, posinf=81.83)
        theta = scan.map_from_sensor.theta  # type: ignore[union-attr]
        pose = f"{scan.map_from_sensor.x} {scan.map_from_sensor.y} "  # type: ignore[union-attr]
        pose += str(np.degrees(theta) if degrees else theta)
        readings = " ".join(f"{reading:.3f}" for reading in ranges)
        lines.append(f"FLASER {len(ranges)} {readings} {pose} {pose} {i * 0.1} host {i * 0.1}")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return carmen(tmp_path / "good.log", degrees=False)


def test_a_good_log(run: Run, log: Path) -> None:
    done = run("doctor", log)
    assert done.status == 0
    assert "examined  80 scans" in done.out
    assert done.out.endswith("found     nothing that is sure\n")


def test_a_fault_is_said_with_its_remedy(run: Run, tmp_path: Path) -> None:
    log = carmen(tmp_path / "degrees.log", degrees=True)
    done = run("doctor", log, "--json")
    assert done.status == 0
    (finding,) = done.json["findings"]
    assert finding["code"] == "pose.headings_in_degrees"
    assert "write headings in radians" in finding["text"]
    assert done.json["sensors"][0]["scans"] == 80
    assert "warning: are these headings in degrees?" in done.err


def test_what_is_no_log_is_one_line(run: Run, tmp_path: Path) -> None:
    done = run("doctor", tmp_path / "none.log")
    assert done.status == 1
    assert len(done.err.splitlines()) == 1
