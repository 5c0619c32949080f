# SPDX-License-Identifier: Apache-2.0
"""Damaged and hostile files: the answer is right, or one line. Nothing else, in no case.

What fails here is run again alone, and printed, by the words in the message:
`python -m tests.fuzz.run --reader NAME --seed 1 --first NUMBER --cases 1 --all`.
"""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from oddsmap.errors import InputError
from tests.fuzz.answers import Answer
from tests.fuzz.judge import BAD, judge, mutant_of
from tests.fuzz.mutant import Files, Mutant, on_file
from tests.fuzz.readers import READERS, Reader

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="the watchdog needs fork, and limits that Linux keeps"
)

_CASES = 100


def outcomes(reader: Reader, seed: int, cases: int) -> tuple[Counter[str], list[str]]:
    from tests.fuzz.watchdog import run_cases

    counts: Counter[str] = Counter()
    bad: list[str] = []
    for number, outcome in run_cases(reader, seed, range(cases)):
        counts[outcome.kind] += 1
        if outcome.kind in BAD:
            again = f"--reader {reader.name} --seed {seed} --first {number}"
            bad.append(f"{again}: {outcome.kind}: {outcome.what[:300]}")
    return counts, bad


@pytest.mark.parametrize("name", READERS)
def test_an_answer_or_one_line(name: str) -> None:
    counts, bad = outcomes(READERS[name], 1, _CASES)
    assert not bad, "\n".join(bad)
    assert counts["ok-same"] < _CASES, "the mutators do nothing"


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_an_answer_or_one_line_a_thousand_times(name: str) -> None:
    _, bad = outcomes(READERS[name], 2, 1000)
    assert not bad, "\n".join(bad)


def test_a_case_is_the_same_each_time() -> None:
    for name in ("npz-beams2", "toml", "octomap-ot"):
        reader = READERS[name]
        first, again = (mutant_of(reader, reader.sample(), 3, 5) for _ in range(2))
        assert first == again
        assert first != mutant_of(reader, reader.sample(), 3, 6)


class TestTheWatchdog:
    """The harness sees what it is there for."""

    def kinds_of(self, read: object) -> list[str]:
        from tests.fuzz.watchdog import run_cases

        def mutate(_: object, content: bytes) -> tuple[bytes, str]:
            return content + b"!", "one byte more"

        reader = Reader(
            "carmen",
            lambda path: Answer("good", ()) if len(path.read_bytes()) == size else read(path),  # type: ignore[operator]
            "a.log",
            (on_file("a.log", mutate, "same"),),
        )
        size = len(reader.sample()["a.log"])
        return [outcome.kind for _, outcome in run_cases(reader, 1, range(2))]

    def test_what_is_fine(self) -> None:
        def refuse(path: Path) -> Answer:
            raise InputError(f"{path}: one byte too many: take it out")

        assert self.kinds_of(lambda _: Answer("good", ())) == ["ok-same"] * 2
        assert self.kinds_of(lambda _: Answer("other", ("1 was skipped",))) == ["ok-legal"] * 2
        assert self.kinds_of(refuse) == ["refused"] * 2

    def test_what_is_not(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def lengthy(path: Path) -> Answer:
            error = InputError("")
            error.args = ("x" * 1000,)
            raise error

        def grow(path: Path) -> Answer:
            return Answer(str(len(bytearray(8 << 30))), ())

        def loop(path: Path) -> Answer:
            while True:
                time.time()

        def die(path: Path) -> Answer:
            os.kill(os.getpid(), 11)
            return Answer("", ())

        monkeypatch.setattr("tests.fuzz.watchdog._CPU_SECONDS", 0.2)
        assert self.kinds_of(lambda _: Answer("other", ())) == ["silent"] * 2
        assert self.kinds_of(lambda _: [][1]) == ["traceback"] * 2
        assert self.kinds_of(lengthy) == ["long-message"] * 2
        assert self.kinds_of(grow) == ["memory"] * 2
        assert self.kinds_of(loop) == ["hang"] * 2
        assert self.kinds_of(die) == ["crash"] * 2


def test_any_legal_value_may_be_another_answer(tmp_path: Path) -> None:
    files: Files = {"a.txt": b"5"}
    for expected, kind in (("any", "ok-legal"), ("same", "silent")):
        reader = Reader("carmen", lambda _: Answer("five", ()), "a.txt", ())
        mutant = Mutant(files, "", expected)  # type: ignore[arg-type]
        assert judge(reader, mutant, Answer("four", ()), tmp_path).kind == kind
