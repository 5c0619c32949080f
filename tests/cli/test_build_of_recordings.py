# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build RECORDING` with each way to say where the poses are."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.conftest import Run

pytest.importorskip("rosbags", reason='recordings need rosbags: pip install "oddsmap[ros]"')

from tests.recordings.bags import Messages, Said
from tests.recordings.test_deskewed import turning
from tests.recordings.test_recorded_log import SECOND, START, drive


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A drive with transforms, and with odometry that is half a metre off."""
    messages = Messages("mcap")
    said: list[Said] = drive(messages)
    for k in range(20):
        now = START + k * SECOND // 10
        here = messages.odometry(now, "odom", "base", (0.05 * k + 0.5, 0.0, 0.0), 0.02 * k)
        said.append(("/odom", now, here))
    return messages.write(tmp_path / "run", said)


@pytest.mark.parametrize("poses", ["tf", "/odom", "poses.txt"])
def test_poses(poses: str, recording: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(recording.parent)
    rows = (f"{START // SECOND + k}.0 {k} 0 0 0 0 0 1\n" for k in range(-1, 4))
    Path("poses.txt").write_text("".join(rows))
    words = ("--poses", poses, "--tolerance", 1, "--resolution", 0.1, "-o", "map.zarr")
    assert run("build", recording, *words).status == 0
    made = run("info", "map.zarr", "--json").json
    assert made["made from"][0]["scans"] == 20


def test_poses_that_are_nowhere(recording: Path, run: Run) -> None:
    said = run("build", recording, "--poses", "/pose", "--resolution", 0.1, "-o", "map.zarr").line
    assert "/pose is neither a file of poses nor a topic: it has /odom, /scan, /tf" in said
    said = run("build", recording, "--poses", "/scan", "--resolution", 0.1, "-o", "map.zarr").line
    assert "/scan is no topic of poses: it has /odom" in said


def test_a_frame_that_is_nowhere(recording: Path, run: Run) -> None:
    said = run("build", recording, "--frame", "world", "--resolution", 0.1, "-o", "map.zarr").line
    assert "to 'world': frames that 'laser' is connected with: base, map" in said


def test_info_of_a_recording_takes_no_poses(recording: Path, run: Run) -> None:
    assert "leave --poses" in run("info", recording, "--poses", "tf").line


def test_deskew(run: Run, tmp_path: Path) -> None:
    path = Messages("bag").write(tmp_path / "turn", turning(Messages("bag")))
    words = (path, "--resolution", 0.1, "-o", tmp_path / "map.zarr", "--force")
    said = {}
    for stated in ("auto", "on", "off"):
        made = run("build", *words, "--deskew", stated)
        assert made.status == 0
        said[stated] = "beams are taken at their own times (deskewed)" in made.out + made.err
    assert said == {"auto": True, "on": True, "off": False}
    scored = run("score", tmp_path / "map.zarr", path, "--deskew", "off", "--json").json
    moved = run("score", tmp_path / "map.zarr", path, "--deskew", "on", "--json").json
    assert scored["log_likelihood"] != moved["log_likelihood"]


def test_deskewing_without_times_is_refused(recording: Path, run: Run) -> None:
    words = ("--deskew", "on", "--poses", "tf", "--resolution", 0.1, "-o", "map.zarr")
    assert "nothing says when each beam was taken" in run("build", recording, *words).line
