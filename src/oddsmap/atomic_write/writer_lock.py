# SPDX-License-Identifier: Apache-2.0
"""One process at a time for what reads an output, adds to it, and replaces it.

Replacing alone needs no lock: the last one stays. Of two that read the same old output, what the
first has added would be lost.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from oddsmap.atomic_write.lock import is_open_at, try_lock, unlock
from oddsmap.errors import OutputError

__all__ = ["LOCK_NAME", "one_writer", "remove_dead_lock"]

LOCK_NAME = re.compile(r"\.oddsmap-.+\.lock")
_PAUSE = 0.05  # between two looks whether the other has finished [s]


@contextmanager
def one_writer(path: Path, waiting: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Hold the lock of an output: a file beside it, that ends with its process.

    Args:
        path: the file or folder that is to be changed.
        waiting: called once where another process holds it, which is waited for.

    Raises:
        OutputError: nothing can be written beside it.
    """
    file = path.parent / f".oddsmap-{path.name}.lock"
    said = False
    while True:
        try:
            number = os.open(file, os.O_CREAT | os.O_RDWR, 0o666)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
        held = try_lock(number)
        # Where there are no locks, whoever replaces looks whether it is still what was read.
        if held is None or (held and is_open_at(number, file)):
            break
        os.close(number)
        if not held:
            if not said:
                waiting()
            said = True
            time.sleep(_PAUSE)
    try:
        yield
    finally:
        _remove(file, number)


def remove_dead_lock(file: Path) -> None:
    """Remove the lock of a process that has ended."""
    with suppress(OSError):
        number = os.open(file, os.O_RDWR)
        if try_lock(number) and is_open_at(number, file):
            _remove(file, number)
        else:
            os.close(number)


def _remove(file: Path, number: int) -> None:
    with suppress(OSError):
        file.unlink(missing_ok=True)
    unlock(number)
    with suppress(OSError):  # Windows removes no file that is open; who waits makes it anew
        if os.name == "nt":
            file.unlink(missing_ok=True)
