# SPDX-License-Identifier: Apache-2.0
"""`oddsmap info` of logs and of maps."""

from __future__ import annotations

from pathlib import Path

import pytest

import oddsmap
from tests.cli.conftest import Run


@pytest.fixture
def saved(run: Run, office: Path, tmp_path: Path) -> Path:
    out = tmp_path / "office.zarr"
    assert run("build", office, "--resolution", 0.1, "-o", out).status == 0
    return out


def test_a_log(run: Run, office: Path) -> None:
    facts = run("info", office, "--json").json
    assert (facts["format"], facts["scans"], facts["beams"]) == ("CARMEN", 20, 3600)
    assert "CARMEN" in run("info", office).out


def test_a_map(run: Run, saved: Path) -> None:
    facts = run("info", saved, "--json").json
    assert facts["cells known"] == oddsmap.load_map(saved).cell_count()
    assert facts["made from"][0]["source"] == "office.log.gz"
    assert "resolution   0.1" in run("info", saved).out


def test_an_octomap(run: Run, tilted_floor: Path, tmp_path: Path) -> None:
    bt = tmp_path / "space.bt"
    assert run("export", tilted_floor, bt).status == 0
    facts = run("info", bt, "--json").json
    assert facts["format"] == "OctoMap"
    assert facts["occupied"] == 40 * 40 + 9
    assert facts["free"] == 40 * 40 - 1
    assert facts["cells known"] == facts["occupied"] + facts["free"]
    assert facts["x [m]"] == pytest.approx([0.0, 4.0])
    assert "0.1 m" in run("info", bt).out
    bt.write_bytes(bt.read_bytes()[:-1])
    assert "cut off" in run("info", bt).line
