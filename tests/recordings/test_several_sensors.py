# SPDX-License-Identifier: Apache-2.0
"""Sensors of one map that state different limits: each reading by those of its own."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from oddsmap import BeamSensor, ConeSensor, Scan, build_full_map, build_map, open_log
from oddsmap.errors import InputError
from tests.kit import votes_of
from tests.recordings.bags import CONTAINERS, Messages, Said
from tests.recordings.test_range_messages import ring
from tests.recordings.test_recorded_log import SECOND, START, drive


def two_lasers(messages: Messages) -> list[Said]:
    """A laser up to 30 m, and one behind up to 5 m that says nothing at 5 m and at +Inf."""
    said = drive(messages)
    behind = messages.transform(START, "base", "rear", (-0.2, 0.0, 0.3), math.pi)
    said.insert(0, ("/tf_static", START, messages.tf(behind)))
    rng = np.random.default_rng(1)
    for k in range(20):
        now = START + k * SECOND // 10
        ranges = rng.uniform(0.02, 4.9, 40)
        ranges[::4], ranges[1::8] = 5.0, np.inf
        scan = messages.laser(now, "rear", ranges)
        scan.range_min, scan.range_max = 0.5, 5.0
        said.append(("/rear", now, scan))
    return said


@pytest.fixture
def path(tmp_path: Path) -> Path:
    messages = Messages("mcap")
    return messages.write(tmp_path / "run", two_lasers(messages))


@pytest.mark.parametrize("container", CONTAINERS)
def test_both_at_once_are_each_alone_and_merged(container: str, tmp_path: Path) -> None:
    messages = Messages(container)
    path = messages.write(tmp_path / "run", two_lasers(messages))
    both = build_map(open_log(path, scans=["/scan", "/rear"]), 0.1)
    alone = build_map(open_log(path, scans="/scan"), 0.1)
    rear = build_map(open_log(path, scans="/rear"), 0.1)
    assert alone.report is not None
    assert rear.report is not None
    assert both.report is not None
    assert both.report.scans == 40
    assert both.report.skipped == alone.report.skipped + rear.report.skipped
    assert both.report.skipped["beam.no_return"] == 200
    assert [entry["sensor"]["range_max"] for entry in both.provenance] == [30.0, 5.0]
    alone.merge(rear)
    assert votes_of(both) == votes_of(alone)


def test_evidence_that_fades(path: Path) -> None:
    """All parts by the time of the last scan of all."""
    both = build_map(open_log(path, scans=["/scan", "/rear"]), 0.1, half_life=1.0)
    when = both.config.map.t_ref_ns
    assert when == START + 19 * SECOND // 10
    alone = build_map(open_log(path, scans="/scan"), 0.1, half_life=1.0, t_ref_ns=when)
    alone.merge(build_map(open_log(path, scans="/rear"), 0.1, half_life=1.0, t_ref_ns=when))
    assert votes_of(both) == votes_of(alone)


def test_whoever_gives_the_sensor_has_decided(path: Path) -> None:
    sensor = BeamSensor(range_max=4.0)
    both = build_map(open_log(path, scans=["/scan", "/rear"]), 0.1, sensor=sensor)
    alone = build_map(open_log(path, scans="/scan"), 0.1, sensor=sensor)
    alone.merge(build_map(open_log(path, scans="/rear"), 0.1, sensor=sensor))
    assert len(both.provenance) == 1
    assert votes_of(both) == votes_of(alone)


def test_one_model_for_all_is_refused(path: Path) -> None:
    log = open_log(path, scans=["/scan", "/rear"])
    with pytest.raises(InputError, match=r"/scan range_min 0.1, .* set range_max and range_min"):
        build_full_map(log, 0.2)


def test_scans_without_their_log_must_agree(path: Path) -> None:
    scans = list(open_log(path, scans=["/scan", "/rear"]))
    with pytest.raises(InputError, match=r"comes from a log that states range_min 0.5, range_m"):
        build_map(scans, 0.1)


def test_sonars_of_other_widths_on_one_topic(tmp_path: Path) -> None:
    messages = Messages("bag")
    said = ring(messages, one_topic=True)
    for topic, _, message in said:
        if topic == "/sonar" and message.header.frame_id == "left":
            message.field_of_view = 0.2
    said.append(("/sonar", START + SECOND, messages.range(START + SECOND, "left", 1.0, angle=9.0)))
    path = messages.write(tmp_path / "run", said)
    log = open_log(path, skip_bad=True)
    made = build_map(log, 0.1)
    assert made.report is not None
    assert made.report.skipped == {"scan.unreadable": 1}
    assert [entry["sensor"]["cone_deg"] for entry in made.provenance] == [28.6479, 11.4592]
    wide: list[Scan] = [scan for scan in log if "left" not in scan.sensor_id]
    narrow = [scan for scan in log if "left" in scan.sensor_id]
    want = build_map(wide, 0.1)
    assert want.sensor == ConeSensor(cone_deg=28.6479, range_min=0.1, range_max=4.0)
    want.merge(build_map(narrow, 0.1))
    assert votes_of(made) == votes_of(want)
