# SPDX-License-Identifier: Apache-2.0
"""`oddsmap calibrate`: a TOML that `oddsmap build` takes."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from oddsmap.evidence_map import load_map
from tests.cli.conftest import Run
from tests.cli.test_score import sonar

__all__ = ["sonar"]

CELL = 0.1


def test_what_is_found_is_what_build_takes(run: Run, sonar: Path, tmp_path: Path) -> None:
    toml, out = tmp_path / "sensor.toml", tmp_path / "m.zarr"
    words = ("--resolution", CELL, "--set", "sensor.sigma=0.1", "--set", "sensor.p_random=0.02")
    done = run("calibrate", sonar, *words, "-o", toml, "--json")
    assert done.status == 0
    facts = done.json
    assert set(facts["parameters"]) == {"cone_deg", "detection", "p_random", "p_dropout", "sigma"}
    assert set(facts["standard_errors"]) == set(facts["parameters"])
    assert facts["beams"] == 360
    assert 0.01 < facts["parameters"]["sigma"] < 0.05
    assert run("build", sonar, "--resolution", CELL, "--config", toml, "-o", out).status == 0
    stored = load_map(out).config.to_dict()["sensor"]
    for name, value in facts["parameters"].items():
        assert stored[name] == pytest.approx(value, rel=1e-4)
    assert (stored["kind"], stored["range_max"]) == ("cone", 2.5)


def test_words(run: Run, sonar: Path, tmp_path: Path) -> None:
    toml = tmp_path / "sensor.toml"
    words = ("calibrate", sonar, "--resolution", CELL, "--noise-only", "-o", toml)
    done = run(*words)
    assert done.status == 0
    assert "used        30 scans, 360 beams" in done.out
    assert "p_random" in done.out
    assert "+-" in done.out
    assert "cone_deg" not in done.out
    assert tomllib.loads(toml.read_text())["sensor"]["cone_deg"] == 25.0
    before = toml.read_bytes()
    assert "exists already" in run(*words).line
    assert run(*words, "--force", "--set", "sensor.p_random=0.3").status == 0
    assert tomllib.loads(before.decode())["sensor"].keys() == (
        tomllib.loads(toml.read_text())["sensor"].keys()
    )


def test_a_log_without_no_returns(run: Run, sonar: Path, tmp_path: Path) -> None:
    toml, bare = tmp_path / "sensor.toml", tmp_path / "bare.npz"
    with np.load(sonar) as arrays:
        beams, remainder = arrays["beams"], {k: v for k, v in arrays.items() if k != "beams"}
    np.savez(bare, beams=beams[beams[:, 3] < 2.5], **remainder)
    words = ("calibrate", bare, "--resolution", CELL, "--noise-only", "-o", toml)
    note = "the log has no no-returns: p_dropout cannot be told from it; kept at 0.05"
    done = run(*words)
    assert done.status == 0
    assert f"{bare}: {note}\n" in done.out
    assert tomllib.loads(toml.read_text())["sensor"]["p_dropout"] == 0.05
    done = run(*words, "--force", "--json")
    assert done.json["notes"] == [note]
    assert set(done.json["parameters"]) == {"p_random", "sigma"}
    assert f"{bare}: {note}\n" in done.err
    done = run("calibrate", sonar, *words[2:], "--force", "--json")
    assert (done.json["notes"], done.err) == ([], "")


def test_wrong_words(run: Run, sonar: Path, office: Path, tmp_path: Path) -> None:
    toml = tmp_path / "s.toml"
    assert run("calibrate", sonar, "-o", toml).status == 2
    words = ("--resolution", CELL, "-o", toml)
    assert "ends in .toml" in run("calibrate", sonar, *words[:2], "-o", "sensor.json").line
    assert "above 0, got 0" in run("calibrate", sonar, *words, "--set", "sensor.p_random=0").line
    line = run("calibrate", sonar, *words, "--set", "posterior.prior=0.2").line
    assert "does not look at posterior.*" in line
    assert "no-returns only" in run(
        "calibrate", sonar, *words, "--set", "sensor.range_max=0.02", "--set",
        "sensor.clear_range=0.02",
    ).line  # fmt: skip
    empty = tmp_path / "empty.npz"
    np.savez(empty, beams=np.empty((0, 4)), cone_deg=25.0, range_max=2.5)
    assert "with n > 0" in run("calibrate", empty, *words).line
    assert not toml.exists()
