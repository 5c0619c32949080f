# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build --auto`, and `calibrate` of narrow beams."""

from __future__ import annotations

import tomllib
from pathlib import Path

import oddsmap
from tests.cli.conftest import Run
from tests.cli.test_score import sonar

__all__ = ["sonar"]


def test_narrow_beams(run: Run, office: Path, tmp_path: Path) -> None:
    auto, plain, toml = tmp_path / "a.zarr", tmp_path / "b.zarr", tmp_path / "sensor.toml"
    words = ("build", office, "--resolution", 0.1, "-o")
    facts = run(*words, auto, "--auto", "--json").json
    assert facts["auto"]["posterior"] == "calibrated"
    assert run(*words, plain).status == 0
    one, other = oddsmap.load_map(auto), oddsmap.load_map(plain)
    # Nothing that is fitted changes a vote.
    assert [a.tolist() for a in one.cells()] == [b.tolist() for b in other.cells()]
    sensor = one.config.to_dict()["sensor"]
    found = facts["auto"]["parameters"]
    assert found
    assert {name: sensor[name] for name in found} == found
    assert sensor["sigma"] == 0.0
    # The same by `calibrate`, which writes a file for other maps.
    done = run("calibrate", office, "--resolution", 0.1, "-o", toml, "--json")
    assert (done.json["estimator"], done.json["parameters"]) == ("filter", found)
    assert tomllib.loads(toml.read_text())["sensor"]["kind"] == "beam"
    told = run("info", auto, "--json").json
    assert told["posterior"] == "calibrated"
    assert told["take"] == f"oddsmap export {auto} OUT --posterior calibrated"
    assert "posterior" not in run("info", plain, "--json").json
    text = run(*words, auto, "--auto", "--force").out
    assert "\nfitted   detection " in text
    assert "\nnote     p_hit, p_miss: kept" in text
    assert "\ntake     the calibrated posterior: --posterior calibrated of oddsmap" in text


def test_wide_beams_become_a_full_map(run: Run, sonar: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.zarr"
    words = ("build", sonar, "--resolution", 0.1, "--auto", "-o", out)
    facts = run(*words, "--json").json
    assert (facts["estimator"], facts["auto"]["posterior"]) == ("full-map", "full-map")
    full = oddsmap.load_full_map(out)
    sensor = full.config.to_dict()["sensor"]
    assert {name: sensor[name] for name in facts["auto"]["parameters"]} == (
        facts["auto"]["parameters"]
    )
    assert full.provenance[0]["posterior"] == "full-map"
    assert "--votes belongs to --estimator filter" in run(*words, "--force", "--votes", "beam").line


def test_what_does_not_go_together(run: Run, office: Path, tmp_path: Path) -> None:
    words = ("build", office, "--resolution", 0.1, "--auto", "-o", tmp_path / "m.zarr")
    assert "a map that forgets" in run(*words, "--half-life-scans", 5).line
    assert not (tmp_path / "m.zarr").exists()
