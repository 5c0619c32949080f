# SPDX-License-Identifier: Apache-2.0
"""Work in threads: results in order, and nobody at work once it has ended."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from oddsmap.map_files import side_by_side as module
from oddsmap.map_files.side_by_side import do_side_by_side


@pytest.fixture(params=[1, 2, 4], autouse=True)
def threads(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(module, "_threads", lambda: request.param)
    count: int = request.param
    return count


def test_everything_is_done_once() -> None:
    done: list[int] = []
    do_side_by_side(done.append, range(200))
    assert sorted(done) == list(range(200))


def test_things_are_taken_as_they_are_worked_on(threads: int) -> None:
    """A shard's tiles are gathered when it is taken: not those of the whole map at once."""
    taken = 0
    ended: list[int] = []
    ahead: list[int] = []

    def items() -> Iterator[int]:
        nonlocal taken
        for i in range(100):
            taken += 1
            ahead.append(taken - len(ended))
            yield i

    def work(i: int) -> None:
        time.sleep(0.0005)
        ended.append(i)

    do_side_by_side(work, items())
    assert max(ahead) <= threads + 2


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

    before = threading.active_count()  # other tests may have left some
    with pytest.raises(type(error)) as caught:
        do_side_by_side(work, range(1000))
    assert caught.value is error
    assert sorted(ended) == sorted(set(begun) - {5})
    assert len(begun) <= 6 + 2 * threads
    assert threading.active_count() < before + 10


def test_an_interrupt_in_the_main_thread() -> None:
    """As Ctrl-C comes, while others are at work."""
    at_work: list[int] = []

    def work(i: int) -> None:
        at_work.append(i)
        time.sleep(0.01)
        at_work.remove(i)

    def items() -> Iterator[int]:
        yield from range(5)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        do_side_by_side(work, items())
    assert at_work == []
