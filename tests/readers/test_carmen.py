# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import sys
from pathlib import Path
from types import FrameType

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.readers import open_log
from oddsmap.readers.carmen import matches
from oddsmap.scans.log import Log
from oddsmap.scans.memory_log import BadLine, LoadedLog

GOOD = "FLASER 2 1.5 2.5 3 4 0.5 3 4 0.5 {stamp} host 11"


def read(tmp_path: Path, *lines: str) -> LoadedLog:
    path = tmp_path / "hall.log"
    path.write_text("\n".join(lines) + "\n")
    log = open_log(path)
    assert isinstance(log, LoadedLog)
    return log


def refused(tmp_path: Path, *lines: str) -> str:
    with pytest.raises(InputError) as caught:
        read(tmp_path, *lines)
    message = str(caught.value)
    assert "\n" not in message
    return message


def scan_line(ranges: list[float], stamp: float = 1.0) -> str:
    values = " ".join(f"{r:.3f}" for r in ranges)
    return f"FLASER {len(ranges)} {values} 3 4 0.5 3 4 0.5 {stamp} host 11"


def robot_line(ranges: list[float], maximum: float) -> str:
    values = " ".join(f"{r:.3f}" for r in ranges)
    return (
        f"ROBOTLASER1 0 -1.0 2.0 0.01 {maximum} 0.01 0 {len(ranges)} {values} 0 "
        "3 4 0.5 7 8 0.9 0.1 0.2 0.3 0.4 100000 10.5 host 11"
    )


def test_other_lines_and_comments_are_neither_scans_nor_skips(tmp_path: Path) -> None:
    log = read(
        tmp_path,
        "# message formats defined: PARAM SYNC ODOM FLASER RLASER",
        "#FLASER 1",
        "PARAM robot_front_laser_max 80.99 nohost 0",
        "",
        "ODOM 0 0 0 0 0 0 1.0 host 1.0",
        GOOD.format(stamp=1),
        "NEFF 3",
        "SYNC tag",
        "FLASERX 3 1 2",
        GOOD.format(stamp=2),
    )
    assert len(log) == 2
    assert not log.skipped
    assert log.notes == ("FLASER with 2 beams: a field of view of 180 degrees is assumed",)
    assert log.sensor == {}  # 80.99 is not used
    first, second = log
    assert first.directions is second.directions


def test_file_order_is_kept_whatever_the_stamps_say(tmp_path: Path) -> None:
    stamps = ["30", "10", "10", "nan", "40"]
    log = read(tmp_path, *(GOOD.format(stamp=s) for s in stamps))
    seconds = [None if s.stamp_ns is None else s.stamp_ns // 10**9 for s in log]
    assert seconds == [30, 10, 10, None, 40]
    text = " | ".join(log.notes)
    assert "2 of 5 time stamps are not later than the one before" in text
    assert "order of the file" in text
    assert "1 scans have no usable time stamp" in text


def test_increasing_stamps_need_no_note(tmp_path: Path) -> None:
    log = read(tmp_path, *(scan_line([1.0] * 180, stamp) for stamp in (1.0, 1.1, 2.0)))
    assert log.notes == ()


def test_bad_lines_are_counted_by_reason_and_the_first_is_quoted(tmp_path: Path) -> None:
    log = read(
        tmp_path,
        GOOD.format(stamp=1),
        "FLASER 180 1 2 3",
        "FLASER 2 1.5 x 3 4 0.5 3 4 0.5 2 host 11",
        "FLASER 2 1.5 2.5 nan 4 0.5 3 4 0.5 3 host 11",
        "FLASER 2 1 1 1 3 4 0.5 3 4 0.5 4 host 11",
        "FLASER 0 3 4 0.5 3 4 0.5 4 host 11",
        "FLASER",
        GOOD.format(stamp=5),
    )
    assert len(log) == 2
    assert log.skipped == {
        "line.short": 2,
        "line.malformed": 1,
        "scan.nan_pose": 1,
        "line.long": 1,
        "scan.empty": 1,
    }
    assert [bad.number for bad in log.bad_lines] == [2, 3, 4, 5, 6]  # the first few
    assert log.bad_lines[1] == BadLine(3, "FLASER needs numbers, got 'x'")
    assert f"6 laser lines were skipped, the first: {log.path}:2: FLASER" in log.notes[0]


def test_line_numbers_count_every_line(tmp_path: Path) -> None:
    path = tmp_path / "hall.log"
    path.write_bytes(b"# a\r\n\r\nODOM 1\r\nFLASER 9\r\n" + GOOD.format(stamp=1).encode())
    log = open_log(path)
    assert isinstance(log, LoadedLog)
    assert log.bad_lines[0].number == 4
    assert len(log) == 1


def test_no_usable_scan_says_what_was_found(tmp_path: Path) -> None:
    path = tmp_path / "hall.log"
    short = scan_line([1.0] * 179).replace("FLASER 179", "FLASER 180")
    message = refused(tmp_path, "# x", "PARAM a b", short, "FLASER 1 x 3 4 5 3 4 5 1 h 1", short)
    assert message.startswith(f"{path}: no usable scan, 3 laser lines were skipped ")
    assert "(line.short 2, line.malformed 1)" in message
    assert f"{path}:3: FLASER announces 180 ranges, the line has 179" in message
    assert "check that the log" in message


def test_no_laser_lines_says_what_was_found(tmp_path: Path) -> None:
    message = refused(tmp_path, "ODOM 1 2", "PARAM a b", "ODOM 1 2", "RAWLASER1 0 1 2")
    assert message.startswith(f"{tmp_path / 'hall.log'}: no laser lines with poses (FLASER, ")
    assert "found ODOM (2), PARAM (1), RAWLASER1 (1)" in message
    assert "give the log" in message
    assert "only comments" in refused(tmp_path, "# CARMEN Logfile")


def test_the_number_for_no_return_is_found(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    lines = []
    for i in range(20):
        ranges = rng.uniform(1.0, 20.0, 180)
        ranges[:3] = 81.83
        lines.append(scan_line(list(ranges), i))
    log = read(tmp_path, *lines)
    assert log.sensor == {"range_max": 81.83}
    assert "81.83 m occurs 60 times at the top of the range: taken as 'no return'" in log.notes
    assert next(iter(log)).ranges[0] == 81.83  # the sensor model, not the reader, drops it


def test_of_several_numbers_the_lowest_is_range_max(tmp_path: Path) -> None:
    ranges = [*np.linspace(1, 20, 50), 32.63, *[32.759] * 6, *[32.767] * 8]
    assert read(tmp_path, scan_line(ranges)).sensor == {"range_max": 32.759}


@pytest.mark.parametrize(("stated", "expected"), [(90.0, 81.83), (80.0, 80.0)])
def test_the_smaller_of_stated_and_found_counts(
    tmp_path: Path, stated: float, expected: float
) -> None:
    ranges = [*np.linspace(1, 20, 50), 80.5, *[81.83] * 8]
    log = read(tmp_path, robot_line(ranges, stated))
    assert log.sensor == {"range_max": expected}
    count = 9 if stated == 80.0 else 0
    note = f"the log states a maximum range of {stated:g} m: {count} readings at or above it"
    assert note in log.notes


def test_of_several_stated_ranges_the_smallest_counts(tmp_path: Path) -> None:
    log = read(tmp_path, robot_line([1.0], 8.0), robot_line([1.0], 30.0), robot_line([1.0], 0.0))
    assert log.sensor == {"range_max": 8.0}
    assert "8 m (the smallest it states): 0 readings" in " | ".join(log.notes)


def test_lines_that_may_repeat_each_other_and_poseless_ones_are_noted(tmp_path: Path) -> None:
    log = read(tmp_path, GOOD.format(stamp=1), robot_line([1.0], 8.0), "RAWLASER1 0", "LASER3 1")
    text = " | ".join(log.notes)
    assert "FLASER and ROBOTLASER1 lines are both used" in text
    assert "2 RAWLASER and LASER lines have no pose" in text


def test_a_log_is_known_by_any_message() -> None:
    for head in (b"PARAM a b\n", b"\n\n# c\nODOM 1", b"# CARMEN Logfile\n", b"RLASER 1"):
        assert matches(head)
    for head in (b"", b"\n \n", b"# FLASER 3\n", b"flaser 3", b"FLASERS 3", b"\x00FLASER 1"):
        assert not matches(head)


REAL_LOGS = [
    ("intel-corrected.log.gz", 910, 180, 81.83, 4172),
    ("freiburg-079-corrected.log.gz", 4791, 360, 81.91, 36004),
    ("aces-corrected.log.gz", 440, 180, 50.0, 620),
    ("belgioioso-corrected.log.gz", 395, 361, 81.91, 699),
    ("orebro-corrected.log.gz", 237, 181, 32.759, 463 + 7 + 465 + 33),
    ("aces-raw.clf.bz2", 7374, 180, 50.0, 11139),
]


@pytest.mark.realdata
@pytest.mark.parametrize(("name", "scans", "beams", "range_max", "no_returns"), REAL_LOGS)
def test_real_logs(
    data_folder: Path, name: str, scans: int, beams: int, range_max: float, no_returns: int
) -> None:
    log: Log = open_log(data_folder / "laser2d" / name)
    assert log.format == "CARMEN"
    assert len(log) == scans
    assert not log.skipped
    assert log.sensor == {"range_max": range_max}
    assert {len(scan.ranges) for scan in log} == {beams}
    assert len({id(scan.directions) for scan in log}) == 1
    assert sum(int((scan.ranges >= range_max).sum()) for scan in log) == no_returns
    assert any("taken as 'no return'" in note for note in log.notes)


@pytest.mark.realdata
def test_a_real_pose_and_its_damaged_stamps(data_folder: Path) -> None:
    log = open_log(data_folder / "laser2d" / "belgioioso-corrected.log.gz")
    scan = next(iter(log))
    pose = scan.map_from_sensor
    np.testing.assert_array_equal(pose.translation, [0.0667143, -0.0410729])
    assert scan.stamp_ns == 1_018_930_000_000_000_000
    assert any(note.startswith("394 of 395 time stamps") for note in log.notes)


def calls_of_reading(path: Path) -> int:
    """How many functions are called to read a log: work that any machine does alike."""
    counts = []
    for _ in range(4):  # the first one imports, and others may call functions meanwhile
        count = 0

        def look(frame: FrameType, event: str, arg: object) -> None:
            nonlocal count
            count += event in ("call", "c_call")

        sys.setprofile(look)
        try:
            open_log(path)
        finally:
            sys.setprofile(None)
        counts.append(count)
    return min(counts)


def test_python_has_little_to_do_for_each_line_and_nothing_for_each_range(tmp_path: Path) -> None:
    """Or else the largest public log, of 1.7 M ranges, would take seconds in place of 0.25 s."""
    calls = {}
    for lines, ranges in ((50, 180), (100, 180), (100, 360)):
        path = tmp_path / f"{lines}-{ranges}.log"
        path.write_text("".join(f"{scan_line([1.25] * ranges, i)}\n" for i in range(lines)))
        calls[lines, ranges] = calls_of_reading(path)
    # Fewer where lines are longer: what a file is, its first bytes tell.
    assert calls[100, 360] <= calls[100, 180]
    assert calls[100, 180] - calls[50, 180] < 50 * 60  # 39 calls a line
