# SPDX-License-Identifier: Apache-2.0
"""What the page is answered is what Python finds; a later question ends an earlier one."""

from __future__ import annotations

import json
import math
import threading
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import BeamSensor, InputError, Scan, build_map
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.log_view import LogView
from oddsmap.viewer import questions
from oddsmap.viewer.drawn_beams import beams_of
from oddsmap.viewer.questions import LogQuestions, SupersededError
from tests.kit import random_scans
from tests.kit3d import random_space_scans
from tests.viewer.journey_kit import log_of

CELL = 0.25
SENSOR = BeamSensor(range_max=5.0)


def asked(scans: list[Scan], **options: Any) -> tuple[oddsmap.EvidenceMap, Any, LogQuestions]:
    log = log_of(scans)
    grid = build_map(log, CELL, sensor=SENSOR, **options)
    return grid, log, LogQuestions(grid, log, len(scans))


def some_points(grid: oddsmap.EvidenceMap) -> Iterator[list[float]]:
    index, hits, passes = grid.cells()
    chosen = [int(np.argmax(hits)), int(np.argmax(passes)), len(index) // 2]
    yield from grid.centre_of(index[chosen]).tolist()
    yield grid.centre_of([index.max(axis=0) + 3])[0].tolist()


@pytest.mark.parametrize("votes", ["scan", "beam"])
@pytest.mark.parametrize("scans", [random_scans(1, 8), random_space_scans(1, 8)], ids=["2D", "3D"])
def test_it_says_what_why_finds(
    scans: list[Scan], votes: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(questions, "LISTED_BEAMS", 1000)
    grid, log, answers = asked(scans, votes=votes)
    for point in some_points(grid):
        answer = json.loads(answers.why(f"at={','.join(map(repr, point))}"))
        found = oddsmap.why(grid, log, point)
        assert answer["cell"] == found.cell.tolist()
        assert answer["complete"] is found.complete is True
        assert (answer["voted"], answer["looked_at"]) == (len(found.scans), 8)
        for kind in ("hits", "passes", "map_hits", "map_passes"):
            assert answer[kind] == getattr(found, kind)
        for said, vote in zip(answer["scans"], found.scans, strict=True):
            assert (said["index"], said["hits"], said["passes"]) == (
                vote.index,
                vote.hits,
                vote.passes,
            )
            assert said["beam_count"] == len(vote.beams) == len(said["beams"])
            assert sorted(said["beams"]) == sorted(vote.beams.tolist())
            assert said["beam_hits"] == sorted(said["beam_hits"], key=lambda hits: hits <= 0)
            check_lines(said, log[vote.index], np.array(found.centre))


def check_lines(said: dict[str, Any], scan: Scan, centre: Any) -> None:
    """What is drawn passes through the cell, along the beam, and a hit ends with its reading."""
    starts, ends = (np.reshape(said[key], (-1, len(centre))) for key in ("starts", "ends"))
    for beam, start, end, reading, hits in zip(
        said["beams"], starts, ends, said["ranges"], said["beam_hits"], strict=True
    ):
        assert reading == (None if math.isinf(scan.ranges[beam]) else scan.ranges[beam])
        way = scan.map_from_sensor.rotation @ scan.directions[beam]
        length = np.linalg.norm(end - start)
        assert np.allclose(start + length * way, end, atol=2e-4)
        along = min(max((centre - start) @ way, 0.0), length)
        assert (
            np.linalg.norm(start + along * way - centre) < CELL * math.sqrt(len(centre)) / 2 + 2e-4
        )
        if hits > 0:
            assert length == pytest.approx(reading, abs=2e-4)


def test_long_answers_are_cut_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(questions, "LISTED_SCANS", 1)
    monkeypatch.setattr(questions, "LISTED_BEAMS", 1)
    grid, log, answers = asked(random_scans(1, 8), votes="beam")
    index, _, passes = grid.cells()
    point = grid.centre_of(index[[np.argmax(passes)]])[0].tolist()
    answer = json.loads(answers.why("at={},{}".format(*point)))
    found = oddsmap.why(grid, log, point)
    assert answer["voted"] == len(found.scans) > 1
    assert [said["index"] for said in answer["scans"]] == [vote.index for vote in found.scans[:1]]
    for said, vote in zip(answer["scans"], found.scans, strict=False):
        assert (len(said["beams"]), said["beam_count"]) == (1, len(vote.beams))


def test_it_says_where_the_log_is_not_all() -> None:
    grid, log, _ = asked(random_scans(1, 8))
    answers = LogQuestions(grid, log_of(list(log.scans[:5])), 5)
    index, _, passes = grid.cells()
    point = grid.centre_of(index[[np.argmax(passes)]])[0].tolist()
    answer = json.loads(answers.why("at={},{}".format(*point)))
    assert answer["complete"] is False
    assert "the scans add up to" in answer["notes"][0]


class OneByOne(LogView):
    """A log that has to be read from the start, and counts how much was read."""

    read = 0

    def __iter__(self) -> Iterator[Any]:
        for scan in self.log:
            OneByOne.read += 1
            yield scan


def lazy(scans: list[Scan]) -> LazyLog:
    return LazyLog(path="run", format="test", scan_count=len(scans), read_scan=scans.__getitem__)


@pytest.mark.parametrize("kind", ["in memory", "one by one", "alone", "with bad ones"])
def test_scans_by_number(kind: str) -> None:
    scans = random_scans(3, 9)
    log: Any = log_of(scans)
    if kind == "one by one":
        log = OneByOne(log)
    elif kind == "alone":
        log = lazy(scans)
    elif kind == "with bad ones":
        log = LazyLog(
            path="run", format="test", scan_count=10, read_scan=with_a_bad_one(scans), skip_bad=True
        )
    grid = build_map(scans, CELL, sensor=SENSOR)
    answers = LogQuestions(grid, log, 9)
    OneByOne.read = 0
    for number in (4, 5, 5, 8, 2, 0):
        said = json.loads(answers.scan(f"number={number}"))
        want = beams_of(scans[number], SENSOR, questions.SHOWN_BEAMS)
        assert np.allclose(np.reshape(said["starts"], (-1, 2)), want.starts, atol=1e-4)
        assert np.allclose(np.reshape(said["ends"], (-1, 2)), want.ends, atol=1e-4)
        assert said["returned"] == want.returned.astype(int).tolist()
        assert (said["readings"], said["silent"]) == (want.readings, want.silent)
    if kind == "one by one":
        assert OneByOne.read == 9 + 3 + 1, "forwards it goes on from where it is"


def with_a_bad_one(scans: list[Scan]) -> Any:
    def read(i: int) -> Scan:
        if i == 3:
            raise InputError("scan 3: cannot be read")
        return scans[i if i < 3 else i - 1]

    return read


def test_a_log_that_has_become_shorter() -> None:
    scans = random_scans(3, 4)
    answers = LogQuestions(build_map(scans, CELL, sensor=SENSOR), OneByOne(log_of(scans[:2])), 4)
    with pytest.raises(InputError, match="has no scan 3 any more"):
        answers.scan("number=3")


BAD_NUMBERS = ("", "number=", "number=8", "number=-1", "number=1.0", "number=01", "number=1&x=2",
    "number=" + "9" * 20, "number=\u0661", "Number=1", "number=1\n", " number=1")  # fmt: skip
BAD_POINTS = ("", "at=", "at=1", "at=1,2,3", "at=1,2,3,4", "at=nan,1", "at=inf,1", "at=1e400,1",
    "at=1e3,1", "at=1,2&at=3,4", "at=1, 2", "at=1,2\n", "at=+1,2", "at=0x1,2", "at=1_0,2",
    "at=" + "9" * 21 + ",1", "at=\u0661,2", "at=1,2;x", "at=1%2C2")  # fmt: skip


def test_queries_of_another_form() -> None:
    _, _, answers = asked(random_scans(1, 8))
    for query in BAD_NUMBERS:
        with pytest.raises(InputError, match=r"^a scan is asked for by number=N, from 0 to 7$"):
            answers.scan(query)
    for query in BAD_POINTS:
        with pytest.raises(InputError, match=r"^a cell is asked about by at=x,y, in metres$"):
            answers.why(query)
    with pytest.raises(InputError, match="cell"):
        answers.why("at=" + "9" * 20 + ",1")


def test_a_later_question_ends_an_earlier_one() -> None:
    grid, log, _ = asked(random_scans(1, 8))
    begun, go_on = threading.Event(), threading.Event()

    class Slow(LogView):
        def __iter__(self) -> Iterator[Any]:
            for number, scan in enumerate(self.log):
                if number == 2 and not begun.is_set():
                    begun.set()
                    assert go_on.wait(20)
                yield scan

    answers = LogQuestions(grid, Slow(log), 8)
    ended: list[BaseException] = []

    def first() -> None:
        try:
            answers.why("at=0.1,0.1")
        except SupersededError as error:
            ended.append(error)

    later: list[bytes] = []
    threads = [threading.Thread(target=first)]
    threads[0].start()
    assert begun.wait(20)
    threads.append(threading.Thread(target=lambda: later.append(answers.why("at=0.6,0.6"))))
    threads[1].start()
    while answers._asked < 2:
        pass
    go_on.set()
    for thread in threads:
        thread.join(20)
    assert len(ended) == 1
    assert json.loads(later[0])["cell"] == [2, 2]
    assert Counter(type(error).__name__ for error in ended) == {"SupersededError": 1}
