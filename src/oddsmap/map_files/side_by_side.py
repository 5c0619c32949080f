# SPDX-License-Identifier: Apache-2.0
"""A few threads pack and write shards, or read and unpack them: zstd and files need no lock."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

__all__ = ["do_side_by_side", "side_by_side"]

# More wait for Python's lock.
_MAX_THREADS = 4

A = TypeVar("A")
B = TypeVar("B")


@contextmanager
def side_by_side(work: Callable[[A], B], items: Iterable[A]) -> Iterator[Iterator[B]]:
    """Do the same with many things, in threads; what comes back is in their order.

    However it ends, by an error or an interrupt too, no thread is at work any more afterwards, and
    nothing is begun after the first error was seen.

    Args:
        work: what to do with one of them; what it raises is raised where its result is asked for.
        items: taken one by one, not much sooner than they are worked on.

    Yields:
        The results; as many things are done as results are taken, and a few more.
    """
    threads = _threads()
    if threads == 1:
        yield map(work, items)
        return
    pool = ThreadPoolExecutor(threads)
    try:
        yield _results(pool, threads, work, items)
    finally:
        pool.shutdown(cancel_futures=True)


def do_side_by_side(work: Callable[[A], None], items: Iterable[A]) -> None:
    """As `side_by_side`, for work that gives nothing."""
    with side_by_side(work, items) as done:
        for _ in done:
            pass


def _results(
    pool: ThreadPoolExecutor, threads: int, work: Callable[[A], B], items: Iterable[A]
) -> Iterator[B]:
    pending: deque[Future[B]] = deque()
    for item in items:
        pending.append(pool.submit(work, item))
        # One more than threads, so that none waits for the results to be taken.
        if len(pending) > threads:
            yield pending.popleft().result()
    while pending:
        yield pending.popleft().result()


def _threads() -> int:
    try:
        cores = len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        cores = os.cpu_count() or 1
    return min(cores, _MAX_THREADS)
