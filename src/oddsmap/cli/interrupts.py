# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C at any moment, also while packages are imported, which takes most of a short command.

Python raises KeyboardInterrupt wherever it is. Inside somebody else's import that may be swallowed
(by a bare `except`), turned into an ImportError, or printed by an extension module. So an import is
finished first, and a second Ctrl-C does not wait for that.
"""

from __future__ import annotations

import atexit
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["Interrupt", "interruptible"]


class Interrupt(BaseException):
    """Ctrl-C. It is no KeyboardInterrupt: the parser of the command line would answer that."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise `Interrupt` inside the block for Ctrl-C, and KeyboardInterrupt where it ends.

    Where Ctrl-C is ignored (a job in the background), or somebody else handles it, it stays so.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed.
    """
    mine = threading.current_thread() is threading.main_thread()
    if not mine or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    handler = _Handler(sys._getframe(2))  # this is 0, `with` is 1, and 2 is who says it
    unraisable = sys.unraisablehook
    sys.unraisablehook = handler.give_again
    signal.signal(signal.SIGINT, handler)
    # The end of the process is not to be a traceback: by then, nothing is left to interrupt.
    atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)
    afterwards: signal.Handlers | Callable[..., object] = signal.default_int_handler
    try:
        yield
        handler.check()
    except SystemExit:
        handler.check()
        raise
    except Interrupt:
        # Now there is an end, and what half-made objects still have to say of theirs is nobody's.
        afterwards, unraisable = signal.SIG_IGN, _say_nothing
        raise KeyboardInterrupt from None
    finally:
        sys.unraisablehook = unraisable
        signal.signal(signal.SIGINT, afterwards)


class _Handler:
    """What answers SIGINT.

    Args:
        base: the frame above which everything is ours to interrupt.
    """

    def __init__(self, base: FrameType) -> None:
        self._base = base
        self._pending = False
        self._raised = False
        self._ignored = 0

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if self._raised and not self._ignored:
            self._ignored += 1  # files are being cleared up: that is for the best, and short
            return
        importing = None if self._pending else self._who_imports(frame)
        if importing is None:
            self._raise()
        self._raise_when(
            lambda now: now is importing or (now.f_back is importing and not _imports(now))
        )

    def check(self) -> None:
        """Raise what has not been raised yet."""
        if self._pending:
            self._raise()

    def give_again(self, unraisable: sys.UnraisableHookArgs) -> None:
        """Ctrl-C that came where nothing can be raised, as in `__del__`, comes a moment later."""
        if unraisable.exc_type is not Interrupt:
            if not self._raised:
                sys.__unraisablehook__(unraisable)
            return
        hook = sys._getframe()
        self._raise_when(lambda now: now is not hook)

    def _raise_when(self, is_time: Callable[[FrameType], bool]) -> None:
        self._pending, self._raised = True, False
        here = sys._getframe()

        def look(frame: FrameType, event: str, arg: object) -> None:
            if frame is not here and is_time(frame):
                self._raise()

        sys.setprofile(look)  # looks at each call and return of this thread

    def _raise(self) -> None:
        sys.setprofile(None)
        self._pending, self._raised, self._ignored = False, True, 0
        raise Interrupt

    def _who_imports(self, frame: FrameType | None) -> FrameType | None:
        """The function of ours whose import statement is being carried out."""
        found = None
        while frame is not None and frame is not self._base:
            if _imports(frame):
                found = frame.f_back
            frame = frame.f_back
        return found


def _say_nothing(unraisable: sys.UnraisableHookArgs) -> None:
    pass


def _imports(frame: FrameType) -> bool:
    return frame.f_code.co_filename.startswith("<frozen importlib")
