# SPDX-License-Identifier: Apache-2.0
"""Commands that are told to end (SIGTERM, SIGHUP) leave nothing unfinished behind."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TextIO

from oddsmap.errors import RecoveryWarning

__all__ = ["ended_by_signals"]

# Windows has no SIGHUP, and no SIGTERM that another process could send.
_SIGNALS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """End as an error does, so that work folders are removed; say what was left by other runs.

    The exit status is that of the shell for a signal: 128 and its number. One that is ignored (by
    `nohup`) stays so.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # handlers belong to the main thread
        return
    before = {
        number: signal.signal(number, _end)
        for number in _SIGNALS
        if signal.getsignal(number) == signal.SIG_DFL
    }
    shown, warnings.showwarning = warnings.showwarning, _in_one_line
    try:
        yield
    finally:
        warnings.showwarning = shown
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(number: int, _: FrameType | None) -> None:
    for each in _SIGNALS:
        signal.signal(each, signal.SIG_IGN)  # a second one must not break off the clearing up
    said = f"oddsmap: ended by {signal.Signals(number).name}: no unfinished output is left\n"
    with suppress(OSError):
        os.write(2, said.encode())  # print may be at work when the signal comes
    raise SystemExit(128 + number)


_shown = warnings.showwarning


def _in_one_line(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    if issubclass(category, RecoveryWarning):
        # Plain print, as the function that this one stands for does.
        print(f"oddsmap: {message}", file=sys.stderr)  # noqa: T201
    else:
        _shown(message, category, filename, lineno, file, line)
