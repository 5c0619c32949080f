# SPDX-License-Identifier: Apache-2.0
"""Scans of some numbers, read without those before them: the same as when all are read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import Scan, open_log
from oddsmap.recordings.chunked_file import ChunkedFile
from oddsmap.recordings.recording import START
from oddsmap.recordings.scan_places import ScanPlaces
from oddsmap.scans.found import Found
from oddsmap.scans.log import parts_of
from tests.recordings.bags import CONTAINERS
from tests.recordings.test_folders import parts
from tests.recordings.troubled import FILES, SCANS, write_troubled


@given(
    messages=st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 1), st.integers(0, 2))),
    topics=st.sets(st.sampled_from("abcd")),
    number=st.integers(0, 30),
)
def test_where_to_begin(
    messages: list[tuple[str, int, int]], topics: set[str], number: int
) -> None:
    """From there on all is read that a walk over everything finds from that number on."""
    places, known = ScanPlaces(), list[tuple[str, tuple[int, int]]]()
    at = (0, 0)
    for topic, file, step in messages:
        at = (at[0] + 1, step) if file else (at[0], at[1] + step)
        places.add(topic, at)
        known.append((topic, at))
    start, first = places.before(topics, number)
    own = [(i, place) for i, (_, place) in enumerate(m for m in known if m[0] in topics)]
    left = [i for i, place in own if place >= start]
    assert left == list(range(first, len(own)))
    assert first <= number
    if start != START:  # nothing earlier would do
        assert number >= len(own) or own[number][1] == start


def facts_of(scan: Any) -> tuple[Any, ...]:
    assert isinstance(scan, Scan)
    pose = scan.map_from_sensor
    numbers = (pose.translation, pose.rotation, scan.directions, scan.ranges)
    return scan.number, scan.sensor_id, scan.stamp_ns, *(np.asarray(n).tobytes() for n in numbers)


@pytest.mark.parametrize("step", [3, 64])
@pytest.mark.parametrize("kind", FILES)
def test_ranges_of_numbers_are_the_log(kind: str, step: int, tmp_path: Path) -> None:
    path = write_troubled(kind, tmp_path)
    log = open_log(path, scans=["/scan", "/rear"], frame="map", skip_bad=True, deskew=True)
    for part in parts_of(log):
        whole = [facts_of(scan) for scan in part]
        said, skipped, all_found = part.notes, part.skipped, part.found.take()
        assert "scan.no_pose" in skipped
        assert part.by_number
        found, scans = Found(), list[Any]()
        for first in reversed(range(0, part.scan_count, step)):
            scans[:0] = [facts_of(scan) for scan in part.between(first, first + step)]
            found.include(part.found.take())
        assert scans == whole
        assert found.bad.keys() == all_found.bad.keys()
        part.found.include(found)
        assert (part.notes, part.skipped) == (said, skipped)


@pytest.mark.parametrize("kind", FILES)
def test_what_is_said_of_the_drive(kind: str, tmp_path: Path) -> None:
    log = open_log(write_troubled(kind, tmp_path), scans="/scan", frame="map", skip_bad=True)
    numbers = [scan.number for scan in log]
    assert sorted(set(range(SCANS)) - set(numbers)) == [0, 1, 2, 9, 100, 101, 102, 103]
    assert log.skipped == {"scan.no_pose": 7, "scan.unreadable": 1, "beam.no_pose": 39}
    codes = {note.code for note in log.notes}
    assert {"sensor.restated", "laser.leans_at_times", "log.bad_scans"} <= codes


@pytest.mark.parametrize("kind", FILES)
def test_a_message_that_cannot_be_decoded_has_no_number(kind: str, tmp_path: Path) -> None:
    path = write_troubled(kind, tmp_path, spoilt=90)
    log: Any = open_log(path, scans=["/scan", "/rear"], frame="map", skip_bad=True)
    whole = [facts_of(scan) for scan in log]
    assert log.skipped["container.truncated"] == 1
    apart = [
        facts_of(scan) for first in range(0, len(log), 5) for scan in log.between(first, first + 5)
    ]
    assert apart == whole


@pytest.mark.parametrize("container", CONTAINERS)
def test_files_of_a_folder(container: str, tmp_path: Path) -> None:
    log: Any = open_log(parts(container, tmp_path / "run"))
    whole = [facts_of(scan) for scan in log]
    assert [scan[0] for scan in whole] == list(range(20))
    for first in range(20):
        apart = [facts_of(scan) for scan in log.between(first, first + 3)]
        assert apart == whole[first : first + 3]


@pytest.mark.parametrize("kind", ["bag", "mcap in chunks"])
def test_chunks_of_the_file_before_are_not_read(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log: Any = open_log(write_troubled(kind, tmp_path), scans="/rear", frame="map", skip_bad=True)
    read = list[int]()
    plain = ChunkedFile._messages_of

    def spied(self: Any, file: Any, block: Any) -> Any:
        read.append(block.start)
        return plain(self, file, block)

    monkeypatch.setattr(ChunkedFile, "_messages_of", spied)
    assert len(list(log)) > 90
    every = len(read)
    assert every > 4
    read.clear()
    assert len(list(log.between(60, 62))) == 2
    assert 1 <= len(read) <= 2


def test_a_channel_that_is_described_twice(tmp_path: Path) -> None:
    """The summary, which is read first, counts; what stands in a chunk would change all later."""
    path = next(write_troubled("mcap", tmp_path).glob("*.mcap"))
    content = path.read_bytes()
    in_chunks = content.count(b"std_msgs/Header header") // 2  # and as often in the summary
    path.write_bytes(content.replace(b"std_msgs/Header h", b"std_msgs/Heaqer h", in_chunks))
    log: Any = open_log(path, scans="/scan", frame="map", skip_bad=True)
    assert "container.truncated" not in log.skipped
    whole = [facts_of(scan) for scan in log]
    assert len(whole) == 96
    assert [facts_of(scan) for scan in log.between(0, len(log))] == whole
    assert "container.truncated" not in log.skipped


def test_damaged_sqlite_is_read_as_a_whole(tmp_path: Path) -> None:
    path = next(write_troubled("sqlite3", tmp_path).glob("*.db3"))
    path.write_bytes(path.read_bytes()[:-4096])
    log: Any = open_log(path, scans="/scan", frame="map", skip_bad=True)
    assert not log.by_number
    whole = [facts_of(scan) for scan in log]
    assert [facts_of(scan) for scan in log.between(0, len(log))] == whole
