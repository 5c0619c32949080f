# SPDX-License-Identifier: Apache-2.0
"""How a log is read, as options say it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap.cli.log_options import LogOptions, read_camera, read_extrinsics
from oddsmap.errors import ConfigError, InputError
from tests.cli.conftest import Run

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
    ):
        with pytest.raises(InputError, match=f"leave `{name}` out for this log"):
            options.open(office)
    with pytest.raises(ConfigError, match="tolerance_s is a time of 0 s or more, got -1"):
        LogOptions(tolerance=-1.0).open(office)


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
