# SPDX-License-Identifier: Apache-2.0
"""Public recordings, each mapped with no option but a topic of scans, or by the command of info."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from tests.cli.conftest import Run

pytest.importorskip("rosbags", reason='recordings need rosbags: pip install "oddsmap[ros]"')

pytestmark = pytest.mark.realdata

GUARDIAN, PALETTE = "ros1/guardian_3.bag", "ros1/palette_facing_windows.bag"
JARVIS = "ros1/jarvis_complex_path_fast.bag"

# Recording, topic (none: it has one), scans used, dimensions; measured.
MAPPED = [
    ("turtlebot3_gazebo.bag", None, 457, 2),
    ("ros1/tilt_laser.bag", None, 178, 3),
    # Its front laser could tilt, and stays within 0.014 degrees of the plane in this recording.
    pytest.param(GUARDIAN, "/scan", 1035, 2, marks=pytest.mark.slow),
    pytest.param(JARVIS, "/driver_laser_navigation/laser_scan", 590, 2, marks=pytest.mark.slow),
    pytest.param(JARVIS, "/driver_laser_security/laser_scan", 616, 2, marks=pytest.mark.slow),
    pytest.param(PALETTE, "/guardian/laser_tilt_front", 420, 3, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("name", "topic", "scans", "ndim"), MAPPED)
def test_with_no_option_but_a_topic(
    name: str, topic: str | None, scans: int, ndim: int, data_folder: Path, tmp_path: Path, run: Run
) -> None:
    words = () if topic is None else ("--scans", topic)
    out = ("--resolution", 0.1, "-o", tmp_path / "a.zarr", "--json")
    facts = run("build", data_folder / "ros" / name, *words, *out).json
    assert facts["scans"] == scans
    assert ("area_m2" in facts) == (ndim == 2)


@pytest.mark.parametrize(
    "name",
    [
        "la3dm_sim_structured.bag",
        pytest.param("turtlebot3_gazebo.bag", marks=pytest.mark.slow),
        pytest.param("ros2/all_types_mcap", marks=pytest.mark.slow),
        pytest.param("ros1/tilt_laser.bag", marks=pytest.mark.slow),
        pytest.param(JARVIS, marks=pytest.mark.slow),
        pytest.param(GUARDIAN, marks=pytest.mark.slow),
        pytest.param(PALETTE, marks=pytest.mark.slow),
        pytest.param("ros1/ship_interior_with_tilting_laser.bag", marks=pytest.mark.slow),
    ],
)
def test_the_command_of_info(
    name: str, data_folder: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (command,) = run("info", data_folder / "ros" / name, "--json").json["map it"]
    assert run(*shlex.split(command)[1:]).status == 0


@pytest.mark.parametrize(
    ("name", "has"),
    [
        ("robot_localization_test1.bag", "/fix (NavSatFix, 989), /husky_velocity_controller/odom"),
        ("no-messages.bag", "no messages"),
    ],
)
def test_no_ranges_is_one_line(
    name: str, has: str, data_folder: Path, tmp_path: Path, run: Run
) -> None:
    path = data_folder / "ros" / "ros1" / name
    said = run("build", path, "--resolution", 0.1, "-o", tmp_path / "a.zarr").line
    assert "PointCloud2, CustomMsg, Range, Image of depth): it has " in said
    assert said.split("it has ")[1].startswith(has)
