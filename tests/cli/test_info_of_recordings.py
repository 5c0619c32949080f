# SPDX-License-Identifier: Apache-2.0
"""`oddsmap info RECORDING`: what is in it, and the command that maps it."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run

pytest.importorskip("rosbags", reason='recordings need rosbags: pip install "oddsmap[ros]"')

from tests.recordings.bags import CONTAINERS, Messages, Said
from tests.recordings.test_depth_messages import filmed, wall
from tests.recordings.test_livox_messages import LATE, POINTS
from tests.recordings.test_range_messages import ring
from tests.recordings.test_recorded_log import SECOND, START, drive
from tests.recordings.test_several_sensors import two_lasers


def by_odometry(ros: Messages, topics: tuple[str, ...]) -> list[Said]:
    """Scans without transforms, with as many topics of odometry."""
    said = [each for each in drive(ros) if each[0] == "/scan"]
    for k in range(20):
        now = START + k * SECOND // 10
        here = ros.odometry(now, "odom", "base", (0.1 * k, 0.0, 0.0), 0.0)
        said += [(topic, now, here) for topic in topics]
    return said


def with_rival_frames(ros: Messages) -> list[Said]:
    said = drive(ros, top="odom")
    for k in range(20):
        now = START + k * SECOND // 10
        moved = ros.transform(now, "base", "map_truth", (-0.04 * k, 0.0, 0.0), 0.0)
        said.append(("/tf", now, ros.tf(moved)))
    return said


def with_a_livox(ros: Messages) -> list[Said]:
    at = START + SECOND
    return [*drive(ros)[:40], ("/livox/lidar", at, ros.livox(at, "laser", POINTS, LATE))]


def with_a_bad_scan(ros: Messages) -> list[Said]:
    said = drive(ros)
    said[2][2].angle_min = float("nan")
    return said


def with_an_image_without_intrinsics(ros: Messages) -> list[Said]:
    """Which is the first topic of scans, and cannot be mapped."""
    return [*filmed(ros, wall(), "32FC1", info=None), *drive(ros)]


# What the command has to say beside the recording, the resolution and the output.
MADE: dict[str, tuple[Callable[[Messages], list[Said]], str]] = {
    "two lasers": (two_lasers, "--scans /rear"),
    "frames": (with_rival_frames, "--frame map_truth"),
    "odometries": (lambda ros: by_odometry(ros, ("/a", "/b")), "--poses /a"),
    "sonars": (ring, "--scans /sonar/front --scans /sonar/left --scans /sonar/right"),
    "sonars of one topic": (lambda ros: ring(ros, one_topic=True), ""),
    "depth": (lambda ros: filmed(ros, wall(), "32FC1"), ""),
    "no intrinsics": (with_an_image_without_intrinsics, "--scans /scan"),
    "livox": (with_a_livox, "--scans /livox/lidar"),
    "a bad scan": (with_a_bad_scan, "--skip-bad"),
}


@pytest.mark.parametrize("name", MADE)
def test_the_command_maps_as_it_is_printed(
    name: str, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, options = MADE[name]
    messages = Messages("mcap")
    monkeypatch.chdir(tmp_path)
    messages.write(Path("a run"), make(messages))
    *_, last = run("info", "a run").out.strip().splitlines()
    label, command = last.split(maxsplit=2)[:2], last.removeprefix("map it").strip()
    assert label == ["map", "it"]
    words = shlex.split(command)
    assert words[:3] == ["oddsmap", "build", "a run"]
    assert words[3:-4] == shlex.split(options)
    assert run(*words[1:]).status == 0
    assert run("info", words[-1], "--json").json["made from"][0]["scans"] > 0


def test_no_poses_at_all(tmp_path: Path, run: Run) -> None:
    messages = Messages("mcap")
    path = messages.write(tmp_path / "run", by_odometry(messages, ()))
    facts = run("info", path, "--json").json
    assert facts["poses"] == ["none: give a file of them (--poses FILE)"]
    assert facts["map it"] == [f"oddsmap build {path} --poses FILE --resolution 0.05 -o run.zarr"]


def test_all_that_is_said(tmp_path: Path, run: Run) -> None:
    """Frames, places, clocks, doubts, and what is not read."""
    messages = Messages("bag")
    said = ring(messages)
    tilted = messages.transform(START, "base", "laser", (0.2, 0.0, 0.3), 1.0)
    said.insert(0, ("/tf_static", START, messages.tf(tilted)))
    for k in range(8):
        now = START + k * SECOND // 10
        said.append(("/scan", now - 7_600_000_000, messages.laser(now, "laser", [2.0] * 9)))
        turned = messages.transform(now, "base", "turret", (0.0, 0.0, 1.0), 0.1 * k)
        said.append(("/tf", now, messages.tf(turned)))
        said.append(("/top", now + 20_000_000, messages.laser(now, "/turret", [2.0] * 9)))
    other = messages.transform(START, "map", "base", (5.0, 0.0, 0.0), 0.0)
    said.append(("/tf", START, messages.tf(other)))
    values = (messages.header(START, "cam"), "32FC1; compressedDepth", np.zeros(9, np.uint8))
    packed = messages.make("sensor_msgs/CompressedImage", *values)
    said.append(("/cam/depth/compressedDepth", START, packed))
    facts = run("info", messages.write(tmp_path / "run", said), "--json").json
    assert facts["topics"]["/top"]["frames"] == ["turret"]
    place = "in the frame laser, at (0.2, 0, 0.3) m, roll 0, pitch 0, yaw 57.3 degrees in base"
    assert facts["scans"]["/scan"] == f"{place}; range_min 0.1, range_max 30"
    assert facts["scans"]["/top"].startswith("in the frame turret, which moves against base; ")
    assert facts["scans"]["/sonar/left"].endswith("; range_min 0.1, range_max 4, cone_deg 28.6479")
    assert facts["clock"]["/scan"] == "its stamps are 7.600 s ahead of the time of writing"
    assert facts["clock"]["/top"] == "written 0.020 s after its stamps"
    assert facts["doubts"] == [
        "1 transforms map to base differ from another of the same stamp: the first of each counts"
    ]
    assert facts["not read"] == {
        "/cam/depth/compressedDepth": "compressed: republish it as raw images (image_transport "
        "republish)"
    }


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
