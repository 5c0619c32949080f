# SPDX-License-Identifier: Apache-2.0
"""`oddsmap info RECORDING`: what is in it, and the command that maps it."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import pytest

from tests.cli.conftest import Run

pytest.importorskip("rosbags", reason='recordings need rosbags: pip install "oddsmap[ros]"')

from tests.recordings.bags import CONTAINERS, Messages
from tests.recordings.test_recorded_log import START, drive


@pytest.mark.parametrize("container", CONTAINERS)
def test_the_command_it_ends_with_maps_the_recording(
    container: str, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages = Messages(container)
    said = drive(messages, top="odom")
    said.append(("/rear", START, messages.laser(START, "laser", [4.0] * 60)))
    path = messages.write(tmp_path / "run", said)
    facts = run("info", path, "--json").json
    where = "in the frame laser, at (0.2, 0, 0.3) m in base; range_min 0.1, range_max 30"
    assert facts["scans"] == {"/rear": where, "/scan": where}
    assert facts["poses"] == ["transforms from odom (--frame odom)"]
    (command,) = facts["map it"]
    monkeypatch.chdir(tmp_path)
    assert run(*shlex.split(command)[1:]).status == 0
    assert (tmp_path / "run.zarr").is_dir()


def test_in_words(tmp_path: Path, run: Run) -> None:
    messages = Messages("bag")
    path = messages.write(tmp_path / "run", drive(messages))
    words = " ".join(run("info", path).out.split())
    assert "/scan: 20 x sensor_msgs/LaserScan, 10.53 per second" in words
    assert "format ROS 1 bag starts 2023-11-14 22:13:20 UTC seconds 1.9" in words


def test_a_recording_of_nothing(tmp_path: Path, run: Run) -> None:
    facts = run("info", Messages("mcap").write(tmp_path / "run", []), "--json").json
    assert facts["topics"] == {}
    assert "map it" not in facts


def test_only_poses(tmp_path: Path, run: Run) -> None:
    messages = Messages("mcap")
    here = messages.odometry(START, "odom", "base", (0.0, 0.0, 0.0), 0.0)
    path = messages.write(tmp_path / "run", [("/odom", START, here)])
    facts = run("info", path, "--json").json
    assert facts["poses"] == ["/odom, in the frame odom (--poses /odom)"]
    assert facts["scans"] == {}


def test_a_folder_beside_other_files_and_a_file_alone(tmp_path: Path, run: Run) -> None:
    messages = Messages("sqlite3")
    path = messages.write(tmp_path / "run", drive(messages))
    (path / "notes.txt").write_text("by hand")
    assert run("info", path, "--json").json["format"] == "ROS 2 recording"
    alone = tmp_path / "alone.db3"
    shutil.copy(next(path.glob("*.db3")), alone)
    assert run("info", alone, "--json").json["format"] == "ROS 2 SQLite file"
