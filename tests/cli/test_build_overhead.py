# SPDX-License-Identifier: Apache-2.0
"""Logs of grids on the command line: told apart by themselves, mapped, and refused elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.simulate import OverheadCamera, office_drive, office_plan
from tests.cli.conftest import Run


@pytest.fixture(scope="module")
def floor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drone's view of the simulated office: 60 grids of labels, one without a pose."""
    rng, plan, camera = np.random.default_rng(2), office_plan(), OverheadCamera(pixel=0.1)
    scans = [camera.scan(plan, pose, rng) for pose in office_drive(60)]
    poses = np.array([(pose.x, pose.y, pose.theta) for pose in office_drive(60)])
    poses[7, 0] = np.nan
    path = tmp_path_factory.mktemp("grids") / "floor.npz"
    grids = np.array([scan.seen for scan in scans]).astype(np.uint8)
    np.savez_compressed(path, grids=grids, poses=poses, pixel=0.1)
    return path


@pytest.mark.parametrize("words", [[], ["--sensor", "overhead"]])
def test_build(run: Run, floor: Path, tmp_path: Path, words: list[str]) -> None:
    out = tmp_path / "floor.zarr"
    facts = run("build", floor, "--resolution", 0.1, *words, "--json", "-o", out).json
    grid = oddsmap.load_map(out)
    assert grid.sensor == oddsmap.OverheadSensor()
    assert grid.votes == facts["votes"] == "scan"
    assert facts["scans"] == 59
    assert facts["skipped"] == {"scan.nan_pose": 1}
    assert facts["beams"] == facts["hits"] + facts["passes"] > 50_000
    assert grid.provenance[0]["sensor"]["kind"] == "overhead"
    # It is a map of the office.
    bounds = grid.bounds()
    assert bounds is not None
    lo, hi = bounds
    truth = office_plan().rasterise(0.1, (int(lo[0]), int(lo[1])), (int(hi[0]), int(hi[1])))
    view = grid.log_odds()
    often = np.abs(view.log_odds()) > 6
    assert np.count_nonzero(often) > 1000
    wrong = (view.probability() > 0.5) != truth
    assert wrong[often].mean() < 0.02


def test_equals_python(run: Run, floor: Path, tmp_path: Path) -> None:
    out = tmp_path / "floor.zarr"
    rate = "sensor.true_positive_rate=0.8"
    run("build", floor, "--resolution", 0.2, "--set", rate, "--threads", 2, "-o", out)
    made = oddsmap.load_map(out)
    assert made.sensor == oddsmap.OverheadSensor(true_positive_rate=0.8)
    grid = oddsmap.build_map(oddsmap.open_log(floor), 0.2)
    assert isinstance(grid.sensor, oddsmap.OverheadSensor)
    for mine, theirs in zip(grid.cells(), made.cells(), strict=True):
        assert np.array_equal(mine, theirs)
    assert made.log_odds().p_hit == pytest.approx(0.8 / 0.9)


def test_export(run: Run, floor: Path, tmp_path: Path) -> None:
    out = tmp_path / "floor.zarr"
    run("build", floor, "--resolution", 0.2, "-o", out)
    for name in ("floor.png", "floor.yaml", "floor.npz"):
        assert run("export", out, tmp_path / name).status == 0
        assert (tmp_path / name).stat().st_size > 0


def test_info(run: Run, floor: Path) -> None:
    facts = run("info", floor, "--json").json
    assert facts["format"] == "NPZ grid log"
    assert facts["scans"] == 60
    assert facts["beams"] == 60 * 40 * 60
    assert facts["notes"] == ["grids of 40 x 60 labels, pixels of 0.1 m"]
    assert "NPZ grid log" in run("info", floor).out


@pytest.mark.parametrize("name", ["lidar2d", "lidar3d", "depth"])
def test_another_sensor_is_refused(run: Run, floor: Path, tmp_path: Path, name: str) -> None:
    out = tmp_path / "x.zarr"
    line = run("build", floor, "--resolution", 0.1, "--sensor", name, "-o", out).line
    assert line.endswith(f"the logs are of overhead, --sensor says {name}")
    assert not out.exists()


def test_other_logs_are_refused(run: Run, floor: Path, office: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.zarr"
    line = run("build", office, "--resolution", 0.1, "--sensor", "overhead", "-o", out).line
    assert line.endswith("the logs are of lidar2d, --sensor says overhead")
    line = run("build", office, floor, "--resolution", 0.1, "-o", out).line
    assert "the logs are of lidar2d and overhead, one map takes one kind" in line
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--set", "sensor.true_positive=0.8"], 'did you mean "true_positive_rate"'),
        (["--set", "sensor.true_positive_rate=0.05"], "must lie below true_positive_rate"),
        (["--range-max", "3"], 'no field of [sensor] of kind overhead is called "range_max"'),
        (["--method", "projective"], "--method projective is for depth images"),
        (["--poses", __file__], None),
    ],
)
def test_settings_that_do_not_fit(
    run: Run, floor: Path, tmp_path: Path, words: list[str], message: str | None
) -> None:
    out = tmp_path / "x.zarr"
    line = run("build", floor, "--resolution", 0.1, *words, "-o", out).line
    assert (message or "an NPZ grid log has poses: leave `poses` out for this log") in line
    assert not out.exists()
