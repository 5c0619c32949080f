# SPDX-License-Identifier: Apache-2.0
"""Work in threads: results in order, and nobody at work once it has ended."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from oddsmap.map_files import side_by_side as module
from oddsmap.map_files.side_by_side import do_side_by_side, side_by_side


@pytest.fixture(params=[1, 2, 4], autouse=True)
def threads(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(module, "_threads", lambda: request.param)
    count: int = request.param
    return count


def test_results_come_in_order() -> None:
    def slow(i: int) -> int:
        time.sleep(0.001 * (i % 3))
        return i * i

    with side_by_side(slow, range(20)) as found:
        assert list(found) == [i * i for i in range(20)]


def test_no_more_is_begun_than_is_taken(threads: int) -> None:
    taken = []

    def items() -> Iterator[int]:
        for i in range(100):
            taken.append(i)
            yield i

    with side_by_side(lambda i: i, items()) as found:
        for _ in range(3):
            next(found)
        assert len(taken) <= 3 + threads


@pytest.mark.parametrize(
    "error", [OSError(28, "No space left"), KeyboardInterrupt(), MemoryError()]
)
def test_what_goes_wrong_ends_it(error: BaseException, threads: int) -> None:
    begun, ended = [], []

    def work(i: int) -> None:
        begun.append(i)
        if i == 5:
            raise error
        time.sleep(0.005)
        ended.append(i)

    with pytest.raises(type(error)) as caught:
        do_side_by_side(work, range(1000))
    assert caught.value is error
    assert sorted(ended) == sorted(set(begun) - {5})
    assert len(begun) <= 6 + 2 * threads
    assert threading.active_count() < 10


def test_an_interrupt_between_two_results() -> None:
    """As it comes to the main thread, while others are at work."""
    at_work: list[int] = []

    def work(i: int) -> None:
        at_work.append(i)
        time.sleep(0.01)
        at_work.remove(i)

    def interrupted() -> None:
        with side_by_side(work, range(100)) as done:
            next(done)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert at_work == []
