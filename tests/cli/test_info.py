# SPDX-License-Identifier: Apache-2.0
"""`oddsmap info` of logs and of maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from tests.cli.conftest import Run
from tests.kit import ONE


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


def test_a_map_whose_log_odds_cannot_be_trusted(run: Run, tmp_path: Path) -> None:
    """1,200 cells that a third of the beams hit: log odds call most of them certainly occupied."""
    rng, grid = np.random.default_rng(0), oddsmap.EvidenceMap(0.1)
    hits = rng.binomial(200, 0.35, 1200)
    index = np.stack([np.arange(1200), np.zeros(1200, np.int64)], axis=1)
    grid.add_cells(index, hits * ONE, (200 - hits) * ONE)
    grid.save(tmp_path / "beside.zarr")
    facts = run("info", tmp_path / "beside.zarr", "--json").json
    told = facts["own votes predicted"]
    assert told["votes"] == 240_000
    assert told["log_odds"] > told["constant"]
    assert told["log_odds_worse_than_constant"] is True
    assert facts["warning"].startswith("log odds are too sure: ")
    assert "--posterior calibrated" in facts["warning"]
    grid.add_cells(index[:1] + 5, np.array([1]), np.array([0]))  # votes that are shared
    grid.save(tmp_path / "shared.zarr")
    facts = run("info", tmp_path / "shared.zarr", "--json").json
    assert "own votes predicted" not in facts
    assert "warning" not in facts


def test_a_map_whose_log_odds_do(run: Run, tmp_path: Path) -> None:
    grid = oddsmap.EvidenceMap(0.1)
    index = np.stack([np.arange(2000), np.zeros(2000, np.int64)], axis=1)
    hits = np.where(index[:, 0] < 700, 9, 0)
    grid.add_cells(index, hits * ONE, (9 - hits) * ONE)
    grid.save(tmp_path / "fine.zarr")
    facts = run("info", tmp_path / "fine.zarr", "--json").json
    assert facts["own votes predicted"]["log_odds_worse_than_constant"] is False
    assert "warning" not in facts
    assert "by log odds 0.0" in run("info", tmp_path / "fine.zarr").out


def test_a_build_says_so_too(run: Run, office: Path, tmp_path: Path) -> None:
    """Of 20 scans: cells that two beams pass stay near one half."""
    words = ("build", office, "--resolution", 0.1, "-o", tmp_path / "m.zarr")
    text = run(*words).out
    assert "\ntrust    log odds are near their prior, with few votes a cell: they " in text
    facts = run(*words, "--force", "--json").json
    told = run("info", tmp_path / "m.zarr", "--json").json["own votes predicted"]
    assert facts["own_votes_predicted"] == told
