# SPDX-License-Identifier: Apache-2.0
"""`build` and `score` of a recording whose sensors state different limits."""

from __future__ import annotations

from pathlib import Path

import pytest

from oddsmap import ConeSensor, build_map, load_map, open_log
from tests.cli.conftest import Run
from tests.kit import votes_of

pytest.importorskip("rosbags", reason='recordings need rosbags: pip install "oddsmap[ros]"')

from tests.recordings.bags import Messages
from tests.recordings.test_range_messages import ring
from tests.recordings.test_recorded_log import SECOND, START
from tests.recordings.test_several_sensors import two_lasers


@pytest.fixture
def path(tmp_path: Path) -> Path:
    messages = Messages("mcap")
    return messages.write(tmp_path / "run", two_lasers(messages))


def test_from_the_command_line(path: Path, run: Run, tmp_path: Path) -> None:
    words = ("--scans", "/scan", "--scans", "/rear", "--resolution", 0.1)
    facts = run("build", path, *words, "-o", tmp_path / "a.zarr", "--json").json
    assert facts["scans"] == 40
    assert facts["skipped"]["beam.no_return"] == 200
    library = build_map(open_log(path, scans=["/scan", "/rear"]), 0.1)
    assert votes_of(load_map(tmp_path / "a.zarr")) == votes_of(library)
    run("build", path, *words, "--range-max", 4.0, "-o", tmp_path / "b.zarr")
    made = load_map(tmp_path / "b.zarr")
    assert [entry["sensor"]["range_max"] for entry in made.provenance] == [4.0, 4.0]
    assert [entry["sensor"]["range_min"] for entry in made.provenance] == [0.1, 0.5]


def test_one_model_for_all_is_refused_unless_what_differs_is_set(path: Path, run: Run) -> None:
    out = path.parent / "map.zarr"
    words = ("--scans", "/scan", "--scans", "/rear")
    build = ("--resolution", 0.1, "--hold-out", 0.2, "-o", out)
    assert run("build", path, *words, *build).status == 0
    said = run("score", out, path, *words, "--held-out").line
    assert "take one at a time (--scans), or set range_max and range_min for all" in said
    settings = ("--set", "sensor.range_max=5", "--set", "sensor.range_min=0.5")
    both = run("score", out, path, *words, *settings, "--held-out", "--json").json
    alone = [
        run("score", out, path, "--scans", name, *settings, "--held-out", "--json").json
        for name in ("/scan", "/rear")
    ]
    assert both["scans"] == sum(each["scans"] for each in alone) == 8


def test_what_is_said_of_the_recording_is_said_once(run: Run, tmp_path: Path) -> None:
    messages = Messages("bag")
    said = [
        (topic, now, message)
        for topic, now, message in two_lasers(messages)
        if topic != "/tf" and topic != "/tf_static"
    ]
    for k in range(20):
        now = START + k * SECOND // 10
        here = messages.odometry(now, "odom", "base", (0.05 * k, 0.0, 0.0), 0.0)
        said.append(("/odom", now, here))
    path = messages.write(tmp_path / "run", said)
    words = ("--scans", "/scan", "--scans", "/rear", "--resolution", 0.1)
    out = run("build", path, *words, "-o", tmp_path / "a.zarr").out
    assert out.count("poses are those of /odom") == 1


def test_the_width_that_a_sonar_does_not_state(run: Run, tmp_path: Path) -> None:
    """The remedy of the doubt works as it is written."""
    messages = Messages("bag")
    said = ring(messages, one_topic=True)
    for topic, _, message in said:
        if topic == "/sonar":
            message.field_of_view = 0.0
    path = messages.write(tmp_path / "run", said)
    build = ("build", path, "--resolution", 0.1)
    said_of_it = run(*build, "-o", tmp_path / "a.zarr").out
    assert "say --sensor sonar --set sensor.cone_deg=DEGREES" in said_of_it
    words = ("--sensor", "sonar", "--set", "sensor.cone_deg=15")
    assert run(*build, *words, "-o", tmp_path / "b.zarr", "--json").json["scans"] == 24
    made = load_map(tmp_path / "b.zarr")
    assert isinstance(made.sensor, ConeSensor)
    assert (made.sensor.cone_deg, made.sensor.range_max) == (15.0, 4.0)
