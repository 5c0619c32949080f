# SPDX-License-Identifier: Apache-2.0
"""Locks on open files, which end with the process that holds them."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

if sys.platform != "win32":
    import fcntl

__all__ = ["is_open_at", "try_lock", "unlock"]

# Beyond what is written: on Windows a locked byte cannot be read by others.
_LOCKED_BYTE = 1 << 20


def try_lock(number: int) -> bool | None:
    """Whether an open file is locked now; None where there are no locks."""
    if sys.platform == "win32":
        import msvcrt

        try:
            os.lseek(number, _LOCKED_BYTE, os.SEEK_SET)
            msvcrt.locking(number, msvcrt.LK_NBLCK, 1)
            os.lseek(number, 0, os.SEEK_SET)
        except OSError:
            return False
        return True
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def unlock(number: int) -> None:
    """Let go of a lock and close its file."""
    if sys.platform != "win32":
        with suppress(OSError):
            # Closing alone would leave it to the children of a process that has forked.
            fcntl.flock(number, fcntl.LOCK_UN)
    os.close(number)


def is_open_at(number: int, path: Path) -> bool:
    """Whether an open file is still the one at a path, or has been removed by another run."""
    try:
        there = path.stat()
    except OSError:
        return False
    return os.path.samestat(os.fstat(number), there)
