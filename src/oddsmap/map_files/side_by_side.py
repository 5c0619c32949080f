# SPDX-License-Identifier: Apache-2.0
"""A few threads pack and write shards: zstd and files need no lock of Python's."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

__all__ = ["do_side_by_side"]

# More wait for Python's lock.
_MAX_THREADS = 4

A = TypeVar("A")


def do_side_by_side(work: Callable[[A], None], items: Iterable[A]) -> None:
    """Do the same with many things, in threads.

    However it ends, by an error or an interrupt too, no thread is at work any more afterwards, and
    nothing is begun after the first error was seen.

    Args:
        work: what to do with one of them; what it raises is raised.
        items: taken one by one, not much sooner than they are worked on.
    """
    threads = _threads()
    if threads == 1:
        for item in items:
            work(item)
        return
    pool = ThreadPoolExecutor(threads)
    try:
        pending: deque[Future[None]] = deque()
        for item in items:
            pending.append(pool.submit(work, item))
            # One more than threads, so that none waits for the next.
            if len(pending) > threads:
                pending.popleft().result()
        while pending:
            pending.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


def _threads() -> int:
    try:
        cores = len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        cores = os.cpu_count() or 1
    return min(cores, _MAX_THREADS)
