# SPDX-License-Identifier: Apache-2.0
"""`oddsmap score`, and `oddsmap build --hold-out`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from oddsmap.evidence_map import build_map, load_map
from oddsmap.full_map.full_map import load_full_map
from oddsmap.readers import open_log
from oddsmap.scans.split_log import hold_out
from oddsmap.scoring.held_out import score_map
from oddsmap.scoring.reflection import score_reflection
from oddsmap.simulate.sonar2d import Sonar2D
from tests.cli.conftest import Run
from tests.scoring.test_calibration import poses, room

CELL = 0.1


@pytest.fixture(scope="module")
def sonar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ring of 12 sonars at 30 poses in a room."""
    ring = Sonar2D(beam_count=12, cone_deg=25.0, range_max=2.5, p_random=0.05, p_dropout=0.05)
    rng = np.random.default_rng(1)
    rows = []
    for pose in poses(30, 1):
        scan = ring.scan(room(), CELL, pose, rng)
        axes = scan.directions @ pose.rotation.T
        heading = np.arctan2(axes[:, 1], axes[:, 0])
        rows += [
            (*pose.translation, a, min(z, 2.5)) for a, z in zip(heading, scan.ranges, strict=True)
        ]
    path = tmp_path_factory.mktemp("logs") / "sonar.npz"
    np.savez(
        path, beams=np.array(rows), cone_deg=25.0, range_max=2.5, p_random=0.05, p_dropout=0.05
    )
    return path


@pytest.fixture
def full(run: Run, sonar: Path, tmp_path: Path) -> Path:
    out = tmp_path / "full.zarr"
    words = ("--resolution", CELL, "--estimator", "full-map", "--hold-out", 0.1, "-o", out)
    done = run("build", sonar, *words, "--json")
    assert (done.status, done.json["scans"], done.json["held_out"]) == (0, 27, 3)
    return out


@pytest.fixture
def evidence(run: Run, sonar: Path, tmp_path: Path) -> Path:
    out = tmp_path / "evidence.zarr"
    done = run("build", sonar, "--resolution", CELL, "--hold-out", 0.2, "-o", out)
    assert done.status == 0
    assert "held out 6 scans" in done.out
    return out


def test_held_out_scans_are_scored_and_were_not_mapped(
    run: Run, sonar: Path, full: Path, evidence: Path
) -> None:
    assert load_map(evidence).provenance[0]["hold_out_every"] == 5
    assert load_full_map(full).provenance[0]["hold_out_every"] == 10
    for path, every in ((full, 10), (evidence, 5)):
        done = run("score", path, sonar, "--held-out", "--json")
        assert done.status == 0
        assert done.err == ""
        assert done.json["held_out_every"] == every
        assert (done.json["scans"], done.json["beams"]) == (30 // every, 12 * (30 // every))
    log = open_log(sonar)
    kept, held = hold_out(log, 10)
    grid = load_full_map(full)
    assert sum(entry["scans"] for entry in grid.provenance) == len(kept) == 27
    expected = score_map(grid, held, grid.config.sensor)
    facts = run("score", full, sonar, "--held-out", "--json").json
    assert facts["log_likelihood"] == expected.log_likelihood
    assert facts["ece"] == expected.ece
    assert [entry["count"] for entry in facts["reliability"]] == expected.reliability.count.tolist()
    assert facts["log_likelihood"] > facts["constant_log_likelihood"]


def test_words(run: Run, sonar: Path, full: Path, tmp_path: Path) -> None:
    picture = tmp_path / "curve.pdf"
    done = run("score", full, sonar, "--held-out", "--plot", picture)
    assert done.status == 0
    assert "scored    3 scans, 36 beams" in done.out
    assert "nats per beam" in done.out
    assert picture.read_bytes().startswith(b"%PDF")
    assert "exists already" in run("score", full, sonar, "--plot", picture).line
    assert run("score", full, sonar, "--plot", picture, "--force").status == 0


def test_scoring_what_was_mapped_is_said(run: Run, sonar: Path, full: Path) -> None:
    done = run("score", full, sonar, "--json")
    assert done.json["scans"] == 30
    assert done.json["held_out_every"] is None
    assert "the map was made from this log: scores are too good" in done.err


def test_another_sensor_model(run: Run, sonar: Path, full: Path) -> None:
    words = ("score", full, sonar, "--held-out", "--json")
    own = run(*words).json
    other = run(*words, "--set", "sensor.p_random=0.5", "--set", "sensor.sigma=0.3").json
    assert other["log_likelihood"] < own["log_likelihood"]
    assert other["beams"] == own["beams"]
    ray = run(*words, "--set", "sensor.kind=beam").json
    assert ray["log_likelihood"] != own["log_likelihood"]


def test_settings_of_other_sections_are_refused(run: Run, sonar: Path, full: Path) -> None:
    line = run("score", full, sonar, "--set", "map.resolution=0.2").line
    assert "does not look at map.*, only at sensor.*" in line


def test_a_second_log_needs_no_hold_out(
    run: Run, sonar: Path, evidence: Path, tmp_path: Path
) -> None:
    second = tmp_path / "second.npz"
    second.write_bytes(sonar.read_bytes())
    done = run("score", evidence, second, "--json")
    assert (done.status, done.json["scans"], done.err) == (0, 30, "")
    line = run("score", evidence, second, "--held-out").line
    assert "no scan of second.npz held out; build it with --hold-out 0.1" in line


def test_a_log_of_another_sensor_is_said(
    run: Run, sonar: Path, office: Path, evidence: Path, tmp_path: Path
) -> None:
    lidar, wider = tmp_path / "lidar.zarr", tmp_path / "wider.npz"
    near, bare = tmp_path / "near.npz", tmp_path / "bare.npz"
    assert run("build", office, "--resolution", 0.2, "-o", lidar).status == 0
    with np.load(sonar) as arrays:
        np.savez(wider, **{**arrays, "cone_deg": 60.0})
        np.savez(near, **{**arrays, "cone_deg": 28.0})
        np.savez(bare, **{name: value for name, value in arrays.items() if name != "cone_deg"})
    cases = (
        (lidar, sonar, "25 degrees wide (sensor.kind cone)", "narrow (sensor.kind beam)"),
        (evidence, bare, "narrow (sensor.kind beam)", "25 degrees wide (sensor.kind cone)"),
        (evidence, wider, "60 degrees wide (sensor.kind cone)", "25 degrees wide (sensor.kind c"),
    )
    for grid, log, theirs, ours in cases:
        for flags in ((), ("--json",)):
            done = run("score", grid, log, *flags)
            assert done.status == 0
            assert done.err.count("\n") == 1
            assert done.err.startswith(
                f"{log}: warning: by what it says of its sensor its beams are "
            )
            assert f"its beams are {theirs}, those of the map's sensor are {ours}" in done.err
    # Nothing to say: what was asked for, and a width that calibration might have found.
    assert run("score", evidence, near).err == ""
    assert run("score", lidar, sonar, "--set", "sensor.kind=cone").err == ""
    assert run("score", lidar, sonar, "--set", "sensor.kind=beam").err == ""
    assert run("score", evidence, wider, "--set", "sensor.cone_deg=25").err == ""
    assert run("score", evidence, wider, "--set", "sensor.cone_deg=60").err == ""
    # The map was made of this log, in the way that somebody chose.
    axes = tmp_path / "axes.zarr"
    words = ("--set", "sensor.kind=beam", "--hold-out", 0.1, "-o", axes)
    assert run("build", sonar, "--resolution", CELL, *words).status == 0
    assert run("score", axes, sonar, "--held-out").err == ""


def test_narrow_beams(run: Run, office: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.zarr"
    assert run("build", office, "--resolution", 0.2, "--hold-out", 0.25, "-o", out).status == 0
    done = run("score", out, office, "--held-out", "--json")
    assert (done.status, done.json["scans"]) == (0, 5)
    assert done.json["beams"] + done.json["skipped"]["beam.no_return"] == 5 * 180
    assert math.isfinite(done.json["log_likelihood"])


@pytest.mark.parametrize("share", [0, 0.6, -1])
def test_wrong_shares(run: Run, sonar: Path, tmp_path: Path, share: float) -> None:
    out = tmp_path / "m.zarr"
    line = run("build", sonar, "--resolution", CELL, "--hold-out", share, "-o", out).line
    assert f"--hold-out {share:g}: the share of scans kept back lies above 0 and up to 0.5" in line
    assert not out.exists()


def test_wrong_words(run: Run, sonar: Path, full: Path, tmp_path: Path) -> None:
    assert "must have a name that ends in .png" in run("score", full, sonar, "--plot", "a.jpg").line
    assert "not a saved map" in run("score", sonar, sonar).line
    assert "no.zarr: no such file" in run("score", tmp_path / "no.zarr", sonar).line
    assert "p_random lies above 0" in (run("score", full, sonar, "--set", "sensor.p_random=0").line)
    overhead = run("score", full, sonar, "--set", "sensor.kind=overhead").line
    assert "a sensor of kind overhead has no forward model" in overhead
    assert "did you mean" in run("score", full, sonar, "--set", "sensor.p_randm=0.1").line


def test_hits_and_passes_are_predicted_by_several_ways(
    run: Run, office: Path, sonar: Path, evidence: Path, full: Path, tmp_path: Path
) -> None:
    out = tmp_path / "m.zarr"
    assert run("build", office, "--resolution", 0.2, "--hold-out", 0.25, "-o", out).status == 0
    words = ("score", out, office, "--held-out")
    facts = run(*words, "--json").json
    ways = facts["reflection"]["predicted_by"]
    assert ways["calibrated"]["log_loss"] < ways["log odds"]["log_loss"]
    assert facts["reflection"]["votes"] > 1000
    assert set(ways["a constant"]) == {
        "log_loss", "ece", "reliability", "below_0.01", "above_0.99"
    }  # fmt: skip
    text = run(*words).out
    assert f"calibrated          {ways['calibrated']['log_loss']:.4f}" in text
    assert ("worse than a constant" in text) == facts["reflection"]["log_odds_worse_than_constant"]
    # The view is scored as a whole, too.
    other = run(*words, "--posterior", "calibrated", "--json").json
    assert (facts["posterior"], other["posterior"]) == ("log-odds", "calibrated")
    assert other["log_likelihood"] != facts["log_likelihood"]
    assert other["reflection"] == facts["reflection"]
    bins = ways["calibrated"]["reliability"]
    assert sum(entry["count"] for entry in bins) == facts["reflection"]["votes"]
    # Hits of wide beams belong to one cell of many, and a full map has none.
    for path, why in ((evidence, "under wide beams: a hit belongs"), (full, "a full map has no")):
        told = run("score", path, sonar, "--json").json
        assert told["reflection"] is None
        assert why in told["no_reflection"]
        assert f"\nhits      {told['no_reflection']}\n" in run("score", path, sonar).out
    line = run("score", full, sonar, "--posterior", "calibrated").line
    assert "a full map has no counts" in line
    line = run(*words, "--posterior", "calibrate").line
    assert 'there is no such view, did you mean "calibrated"?' in line


def test_scans_of_another_place_have_no_known_cell(run: Run, office: Path, tmp_path: Path) -> None:
    grid, far = tmp_path / "m.zarr", tmp_path / "far.npz"
    assert run("build", office, "--resolution", 0.2, "-o", grid).status == 0
    np.savez(far, beams=np.array([[900.0, 900.0, 0.1 * i, 1.0] for i in range(20)]), range_max=5.0)
    done = run("score", grid, far)
    assert done.status == 0
    assert "hits      no beam of these scans enters a cell that the map knows" in done.out
    assert run("score", grid, far, "--json").json["reflection"] is None


def test_runs_of_scans_are_held_out(run: Run, office: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.zarr"
    words = ("build", office, "--resolution", 0.2, "-o", out)
    done = run(*words, "--hold-out", 0.25, "--blocks", "--json")
    assert (done.json["scans"], done.json["held_out"]) == (16, 4)
    entry = load_map(out).provenance[0]
    assert (entry["hold_out_every"], entry["hold_out_run"]) == (4, 2)
    facts = run("score", out, office, "--held-out", "--json").json
    assert (facts["scans"], facts["held_out_every"], facts["held_out_run"]) == (4, 4, 2)
    kept, held = hold_out(open_log(office), 4, 2)
    grid, other = build_map(kept, 0.2), build_map(held, 0.2)
    assert facts["reflection"]["votes"] == score_reflection(grid, other).votes
    assert "add --hold-out 0.1" in run(*words, "--force", "--blocks").line


def test_occupancy_by_a_map_that_is_right(
    run: Run, office: Path, full: Path, sonar: Path, tmp_path: Path
) -> None:
    """By each kind of map: cells that it calls free or occupied are scored, by all ways."""
    out, plane = tmp_path / "m.zarr", tmp_path / "truth.yaml"
    assert run("build", office, "--resolution", 0.2, "--hold-out", 0.25, "-o", out).status == 0
    assert run("export", out, plane).status == 0
    words = ("score", out, office, "--held-out")
    for truth in (out, plane):
        told = run(*words, "--truth", truth, "--json").json["occupancy"]
        assert set(told["told_by"]) == {
            "log odds", "OctoMap's clamps", "calibrated", "a constant"
        }  # fmt: skip
        assert told["told_by"]["log odds"]["iou"] == 1.0
        assert told["cells"] + told["cells_without_truth"] == load_map(out).cell_count()
    assert "occupied  " in run(*words, "--truth", plane).out
    assert run(*words, "--json").json["occupancy"] is None
    told = run("score", full, sonar, "--truth", full, "--json").json["occupancy"]
    assert set(told["told_by"]) == {"full map", "a constant"}
    assert "no.yaml: no such file" in run(*words, "--truth", tmp_path / "no.yaml").line
    assert str(sonar) in run(*words, "--truth", sonar).line


def test_without_range_max_hits_and_passes_are_scored(run: Run, tmp_path: Path) -> None:
    log, grid = tmp_path / "beams.npz", tmp_path / "m.zarr"
    rows = [(0.05 * i, 0.0, 0.1 * k, 2.0) for i in range(10) for k in range(60)]
    np.savez(log, beams=np.array(rows))
    assert run("build", log, "--resolution", CELL, "--hold-out", 0.2, "-o", grid).status == 0
    done = run("score", grid, log, "--held-out")
    assert done.status == 0
    assert done.out.startswith("beams     not scored: sensor.range_max is needed")
    assert " votes of these scans in known cells" in done.out
    found = run("score", grid, log, "--held-out", "--json").json
    assert found["log_likelihood"] is None
    assert found["reflection"]["votes"] > 0
    # What can't be drawn is not left out silently.
    picture = tmp_path / "p.png"
    assert run("score", grid, log, "--held-out", "--plot", picture).status == 1
    assert not picture.exists()
    limited = run("score", grid, log, "--held-out", "--set", "sensor.range_max=9")
    assert limited.out.startswith("scored ")
