# SPDX-License-Identifier: Apache-2.0
"""Scans of a log by number, and its poses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from oddsmap import InputError, Scan
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.log_items import LogItems
from oddsmap.scans.memory_log import LoadedLog

SCANS = tuple(Scan.from_angles((0.5 * i, 1.0, 0.1), [0.0], [2.0]) for i in range(6))


class Stream(LogItems):
    """Scans one after the other, and a count of those that were asked for."""

    def __init__(self) -> None:
        self.read = 0

    def __iter__(self) -> Iterator[Any]:
        for scan in SCANS:
            self.read += 1
            yield scan


def read_scan(i: int) -> Scan:
    if i == 2:
        raise InputError("scan 2 is torn")
    return Scan(SCANS[i].map_from_sensor, SCANS[i].directions, SCANS[i].ranges)


def lazy(*, skip_bad: bool) -> LazyLog:
    return LazyLog(path="run", format="toy", scan_count=6, read_scan=read_scan, skip_bad=skip_bad)


LOADED = LoadedLog("hall.log", "toy", {}, Counter(), (), SCANS)


@pytest.mark.parametrize("log", [Stream(), LOADED], ids=["stream", "loaded"])
def test_items_are_those_of_a_list_of_all(log: Any) -> None:
    for i in (0, 3, 5, -1, -6, np.int64(2)):
        assert log[i] is SCANS[i]
    for part in (slice(2), slice(1, None, 2), slice(-2, None), slice(None, None, -1), slice(9, 12)):
        assert log[part] == list(SCANS[part])
    for i in (6, -7):
        with pytest.raises(IndexError, match=f"no scan {i}"):
            log[i]
    with pytest.raises(TypeError):
        log[1.0]
    with pytest.raises(ValueError, match="zero"):
        log[::0]
    assert [(pose.x, pose.y) for pose in log.poses] == [(0.5 * i, 1.0) for i in range(6)]


def test_a_stream_is_read_no_further_than_needed() -> None:
    stream = Stream()
    assert stream[1:4:2] == [SCANS[1], SCANS[3]]
    assert stream.read == 4
    assert stream[0] is SCANS[0]
    assert stream.read == 5


def test_scans_on_demand_are_read_alone() -> None:
    log = lazy(skip_bad=False)
    assert log[5].map_from_sensor.x == log[-1].map_from_sensor.x == 2.5
    with pytest.raises(InputError, match="torn"):
        log[2]
    with pytest.raises(IndexError, match="of 6 scans none is 6"):
        log[6]


def test_bad_scans_that_are_left_out_have_no_number() -> None:
    log = lazy(skip_bad=True)
    assert [scan.map_from_sensor.x for scan in log] == [0.0, 0.5, 1.5, 2.0, 2.5]
    assert log[2].map_from_sensor.x == 1.5
    assert len(log.poses) == 5
