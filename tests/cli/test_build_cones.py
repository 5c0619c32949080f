# SPDX-License-Identifier: Apache-2.0
"""Wide beams through the command line, and the examples that write their logs."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap.sensors.cone import ConeSensor
from tests.cli.conftest import Run


@pytest.fixture(scope="module")
def sonar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four positions, six wide beams each, one of which sees nothing."""
    headings = np.arange(24) % 6 * (math.pi / 3)
    beams = np.stack([np.arange(24) // 6 * 0.5, np.zeros(24), headings, np.full(24, 1.5)], axis=1)
    beams[::6, 3] = 3.0
    path = tmp_path_factory.mktemp("logs") / "sonar.npz"
    np.savez(path, beams=beams, cone_deg=25.0, range_max=3.0, p_random=0.1, p_dropout=0.05)
    return path


@pytest.fixture(scope="module")
def tof(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six wide 3D beams, along the axes."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    beams = np.concatenate([np.full((6, 3), 0.05), axes, np.full((6, 1), 1.0)], axis=1)
    path = tmp_path_factory.mktemp("logs") / "tof.npz"
    np.savez(path, beams=beams, cone_deg=10.0, range_max=4.0)
    return path


def test_a_sonar_log_just_works(run: Run, sonar: Path, tmp_path: Path) -> None:
    done = run("build", sonar, "--resolution", 0.1, "-o", tmp_path / "m.zarr", "--json")
    assert (done.status, done.json["scans"], done.json["beams"]) == (0, 4, 24)
    assert (done.json["votes"], done.json["hits"]) == ("beam", 20.0)
    grid = oddsmap.load_map(tmp_path / "m.zarr")
    assert grid.ndim == 2
    assert grid.sensor == ConeSensor(cone_deg=25.0, range_max=3.0, p_random=0.1, p_dropout=0.05)
    assert grid.provenance[0]["sensor"]["kind"] == "cone"
    assert run("export", tmp_path / "m.zarr", tmp_path / "m.png").status == 0


def test_a_log_of_space(run: Run, tof: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.zarr"
    done = run("build", tof, "--resolution", 0.1, "-o", out, "--sensor", "tof", "--json")
    assert (done.status, done.json["hits"]) == (0, 6.0)
    grid = oddsmap.load_map(out)
    assert (grid.ndim, grid.sensor) == (3, ConeSensor(cone_deg=10.0, range_max=4.0))
    picture = ("--z-min", 0.0, "--z-max", 0.5)
    assert run("export", out, tmp_path / "m.png", *picture).status == 0


@pytest.mark.parametrize("name", ["sonar", "tof"])
def test_both_names_stand_for_cones(run: Run, sonar: Path, tmp_path: Path, name: str) -> None:
    words = ("build", sonar, "--resolution", 0.1, "-o", tmp_path / "m.zarr", "--sensor", name)
    assert run(*words).status == 0
    assert oddsmap.load_map(tmp_path / "m.zarr").sensor.kind == "cone"


@pytest.mark.parametrize("name", ["lidar2d", "lidar3d", "depth", "overhead"])
def test_other_names_would_lose_the_width(run: Run, sonar: Path, tmp_path: Path, name: str) -> None:
    words = ("build", sonar, "--resolution", 0.1, "-o", tmp_path / "m.zarr", "--sensor", name)
    line = run(*words).line
    assert line.startswith(f"{sonar}: beams are 25 degrees wide, --sensor {name} would lose that")
    assert not (tmp_path / "m.zarr").exists()


def test_the_axes_alone_when_asked_for(run: Run, sonar: Path, tmp_path: Path) -> None:
    words = ("build", sonar, "--resolution", 0.1, "-o", tmp_path / "m.zarr")
    done = run(*words, "--set", "sensor.kind=beam")
    assert done.status == 0
    assert "beams are 25 degrees wide, sensor.kind beam maps their axes alone" in done.out
    assert oddsmap.load_map(tmp_path / "m.zarr").sensor.kind == "beam"
    done = run(*words[:-1], tmp_path / "cones.zarr")
    assert "degrees wide" not in done.out


def test_a_lidar_log_is_no_sonar_unless_told_its_angle(
    run: Run, office: Path, tmp_path: Path
) -> None:
    words = ("build", office, "--resolution", 0.2, "-o", tmp_path / "m.zarr", "--sensor", "sonar")
    assert "a sensor of kind cone needs sensor.cone_deg" in run(*words).line
    assert not (tmp_path / "m.zarr").exists()
    assert run(*words, "--set", "sensor.cone_deg=15").status == 0
    assert oddsmap.load_map(tmp_path / "m.zarr").votes == "beam"


def test_settings(run: Run, sonar: Path, tmp_path: Path) -> None:
    """The textbook's cone: one full hit to every cell of the arc."""
    settings = (
        "share_hit=false", "cone_deg=30", "p_hit=0.7006", "p_miss=0.4013", "pass_falloff=0.5"
    )  # fmt: skip
    words = [word for setting in settings for word in ("--set", f"sensor.{setting}")]
    done = run("build", sonar, "--resolution", 0.1, "-o", tmp_path / "m.zarr", "--json", *words)
    sensor = oddsmap.load_map(tmp_path / "m.zarr").sensor
    assert isinstance(sensor, ConeSensor)
    assert (sensor.share_hit, sensor.cone_deg, sensor.p_hit) == (False, 30, 0.7006)
    assert done.json["hits"] > 60


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("sensor.cone=20", 'no field of [sensor] of kind cone is called "cone", did you mean'),
        ("sensor.cone_deg=181", "up to 180 degrees, got 181"),
        ("sensor.fade=2", 'no field of [sensor] of kind cone is called "fade"'),
        ("sensor.pass_falloff=2", "sensor.pass_falloff lies between 0 and 1, got 2"),
        ("sensor.share_hit=1", "sensor.share_hit is true or false, got 1"),
    ],
)
def test_wrong_settings(run: Run, sonar: Path, tmp_path: Path, setting: str, message: str) -> None:
    out = tmp_path / "m.zarr"
    assert message in run("build", sonar, "--resolution", 0.1, "-o", out, "--set", setting).line
    assert not out.exists()


def test_sonar_of_a_world_that_changes(run: Run, sonar: Path, tmp_path: Path) -> None:
    """A log with stamps forgets; one without says what it lacks."""
    with np.load(sonar) as file:
        arrays = dict(file)
    stamps = np.arange(24) // 6 * 10 * 10**9  # four scans, ten seconds apart
    stamped = tmp_path / "stamped.npz"
    np.savez(stamped, stamp_ns=stamps, **arrays)
    words = ("--resolution", 0.1, "--json", "--set", "map.half_life=10")
    done = run("build", stamped, "-o", tmp_path / "m.zarr", *words)
    assert done.status == 0
    # Five hits a scan; those of the last weigh 1, those before half of it, and so on. Each cell's
    # share of a hit is rounded to 1/65536.
    assert done.json["hits"] == pytest.approx(5 * (1 + 1 / 2 + 1 / 4 + 1 / 8), abs=0.01)
    assert "a scan has no stamp" in run("build", sonar, "-o", tmp_path / "n.zarr", *words).line


def test_info_says_how_wide_beams_are(run: Run, sonar: Path, tof: Path) -> None:
    assert run("info", sonar, "--json").json["sensor"]["cone_deg"] == 25.0
    assert "cone_deg 10" in run("info", tof).out


def example(name: str) -> Any:
    path = Path(__file__).resolve().parents[2] / "examples" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "folder", "scans", "beams", "cone_deg"),
    [
        ("udacity", "sonar/udacity", 413, 413 * 8, 15.0),
        ("ring12", "sonar/ring12", 300, 300 * 12, 15.0),
    ],
)
def test_examples_of_sonar(
    data_folder: Path, tmp_path: Path, name: str, folder: str, scans: int, beams: int,
    cone_deg: float,
) -> None:  # fmt: skip
    example(name).main(str(data_folder / folder), str(tmp_path / "log.npz"))
    log = oddsmap.open_log(tmp_path / "log.npz")
    assert (len(log), sum(scan.size for scan in log)) == (scans, beams)
    assert log.sensor["cone_deg"] == cone_deg
    grid = oddsmap.build_map(log, 0.1)
    assert grid.cell_count() > 6000


@pytest.mark.realdata
@pytest.mark.parametrize("run_name", ["R0", "A0"])
def test_the_panel_is_where_the_motion_capture_saw_it(
    data_folder: Path, tmp_path: Path, run_name: str
) -> None:
    folder = data_folder / "tof8x8" / run_name
    example("tof8x8").main(str(folder), str(tmp_path / "log.npz"))
    grid = oddsmap.build_map(oddsmap.open_log(tmp_path / "log.npz"), 0.05)
    lines = (folder / "state_Vicon.csv").read_text(encoding="utf-8").splitlines()
    panel = np.array([[*map(float, line.split(",")[2:5])] for line in lines if "Surface" in line])
    index, hits, _ = grid.cells()
    centres = (index + 0.5) * 0.05
    near = np.linalg.norm(centres - panel.mean(axis=0), axis=1) < 0.3
    assert hits[near].sum() > 100 * 65536
    plane = np.average(centres[near, 0], weights=hits[near])
    assert abs(plane - panel[:, 0].mean()) < 0.05
