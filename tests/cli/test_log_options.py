# SPDX-License-Identifier: Apache-2.0
"""How a log is read, as options say it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.cli.log_options import LogOptions, read_camera, read_extrinsics
from oddsmap.errors import ConfigError, InputError
from tests.cli.conftest import Run
from tests.readers.clouds import pcd_bytes

PLACE, LENS = "x y z qx qy qz qw", "fx fy cx cy width height"


def test_numbers_with_spaces_or_commas() -> None:
    for text in ("1 2 3 0 0 0 1", "1,2,3,0,0,0,1", " 1, 2, 3 0 0 0 1.0"):
        pose = read_extrinsics(text)
        assert pose is not None
        assert pose.translation.tolist() == [1.0, 2.0, 3.0]
        assert np.array_equal(pose.rotation, np.eye(3))
    camera = read_camera("500 501 320 240 640 480")
    assert camera is not None
    assert (camera.fx, camera.fy, camera.width, camera.height) == (500.0, 501.0, 640, 480)
    assert read_extrinsics(None) is None
    assert read_camera(None) is None


@pytest.mark.parametrize(
    "text", ["", "1 2 3", "1 2 3 0 0 0 nan", "1 2 3 0 0 0 inf", "a b c d e f g"]
)
def test_wrong_numbers(text: str) -> None:
    with pytest.raises(
        ConfigError, match=f'--body-from-sensor "{text}": needs the numbers {PLACE}'
    ):
        read_extrinsics(text)
    with pytest.raises(ConfigError, match=f'--camera "{text}": needs the numbers {LENS}'):
        read_camera(text)


def test_each_option_reaches_the_reader(office: Path) -> None:
    assert len(LogOptions().open(office)) == 20
    for options, name in (
        (LogOptions(poses=office), "poses"),
        (LogOptions(times=office), "times"),
        (LogOptions(extrinsics=read_extrinsics("0 0 0 0 0 0 1")), "body_from_sensor"),
        (LogOptions(camera=read_camera("9 9 9 9 9 9")), "camera"),
        (LogOptions(points_in="map"), "points_in"),
        (LogOptions(origin=(0.0, 0.0, 0.0)), "origin"),
        (LogOptions(columns="x,y,z"), "columns"),
        (LogOptions(depth_scale=1000.0), "depth_scale"),
    ):
        with pytest.raises(InputError, match=f"leave `{name}` out for this log"):
            options.open(office)
    with pytest.raises(ConfigError, match="tolerance_s is a time of 0 s or more, got -1"):
        LogOptions(tolerance=-1.0).open(office)


def test_what_clouds_do_not_say_of_themselves(run: Run, tmp_path: Path) -> None:
    """The frame of points whose pose is VIEWPOINT, and columns of other programs."""
    cloud, out = tmp_path / "a.pcd", tmp_path / "x.zarr"
    cloud.write_bytes(pcd_bytes(np.array([[5.05, 0.05, 0.05]]), viewpoint="1.05 0.05 0.05 1 0 0 0"))
    words = ["build", cloud, "--resolution", 0.1, "-o", out, "--json", "--force"]
    assert "say --points-in sensor or --points-in map" in run(*words).line
    assert "say --points-in sensor or --points-in map" in run("info", cloud).line
    for frame, x in (("map", 50), ("sensor", 61)):
        facts = run(*words, "--points-in", frame).json
        assert facts["hits"] == 1
        assert run("info", cloud, "--points-in", frame, "--json").json["beams"] == 1
        index, hits, _ = oddsmap.load_map(out).cells()
        assert index[hits > 0][:, 0].tolist() == [x]
    (tmp_path / "bins").mkdir()
    scan = np.random.default_rng(0).uniform(-9.0, 9.0, (100, 6)).astype(np.float32)
    scan.tofile(tmp_path / "bins" / "0.bin")
    (tmp_path / "bins" / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    words = ["build", tmp_path / "bins", "--resolution", 1, "-o", out, "--json", "--force"]
    assert "cannot be told" in run(*words).line
    assert run(*words, "--columns", "x,y,z,nx,ny,nz").json["beams"] == 100
    assert "columns are names with x, y and z once each" in run(*words, "--columns", "x,y").line


def test_a_damaged_log(office: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.gz"
    bad.write_bytes(office.read_bytes()[:3000])
    with pytest.raises(InputError):
        LogOptions().open(bad)
    assert LogOptions(skip_bad=True).open(bad).skipped["container.truncated"] == 1


@pytest.mark.parametrize("command", ["build", "score", "calibrate"])
def test_wrong_numbers_are_refused_before_a_log_is_opened(
    run: Run, tmp_path: Path, command: str
) -> None:
    words = {
        "build": ("gone.log", "--resolution", 1, "-o", tmp_path / "m.zarr"),
        "score": ("gone.zarr", "gone.log"),
        "calibrate": ("gone.log", "--resolution", 1, "-o", tmp_path / "s.toml"),
    }[command]
    assert LENS in run(command, *words, "--camera", "1 2").line
    assert PLACE in run(command, *words, "--body-from-sensor", "1 2").line


@pytest.mark.parametrize("command", ["build", "score", "calibrate"])
def test_the_scale_of_depths(run: Run, tmp_path: Path, office: Path, command: str) -> None:
    grid = tmp_path / "m.zarr"
    run("build", office, "--resolution", 0.2, "-o", grid)
    words = {
        "build": (office, "--resolution", 1, "-o", tmp_path / "n.zarr"),
        "score": (grid, office),
        "calibrate": (office, "--resolution", 1, "-o", tmp_path / "s.toml"),
    }[command]
    assert "leave `depth_scale` out" in run(command, *words, "--depth-scale", "1000").line
    assert "depth_scale is how many units" in run(command, *words, "--depth-scale", "0").line


@pytest.mark.parametrize("command", ["build", "score", "calibrate", "info"])
def test_where_a_sensor_stood(run: Run, tmp_path: Path, command: str) -> None:
    cloud, grid = tmp_path / "a.pcd", tmp_path / "m.zarr"
    cloud.write_bytes(pcd_bytes(np.random.default_rng(0).uniform(2.0, 9.0, (300, 3))))
    run("build", cloud, "--origin", "-1", "-2.5", "0", "--resolution", 0.5, "-o", grid)
    words = {
        "build": (cloud, "--resolution", 0.5, "-o", tmp_path / "n.zarr", "--json"),
        "score": (grid, cloud, "--json"),
        "calibrate": (cloud, "--resolution", 0.5, "-o", tmp_path / "s.toml", "--json"),
        "info": (cloud, "--json"),
    }[command]
    place = ("--origin", "-1", "-2.5", "0")
    assert "origin is three numbers" in run(command, *words, "--origin", "0", "0", "nan").line
    if command == "info":
        assert run(command, *words, *place).json["y [m]"] == [-2.5, -2.5]


def test_the_place_of_a_sensor_in_a_file(run: Run, tmp_path: Path) -> None:
    cloud, mount = tmp_path / "a.pcd", tmp_path / "mount.txt"
    cloud.write_bytes(pcd_bytes(np.array([[1.0, 0.0, 0.0]])))
    mount.write_text("1 0 0 5\n0 1 0 6\n0 0 1 7\n0 0 0 1\n")
    grid = tmp_path / "m.zarr"
    words = ("build", cloud, "--resolution", 0.5, "-o", grid, "--json", "--set", "map.votes='beam'")
    assert run(*words, "--body-from-sensor", mount).json["hits"] == 1.0
    index, hits, _ = oddsmap.load_map(grid).cells()
    assert index[hits > 0].tolist() == [[12, 12, 14]]
