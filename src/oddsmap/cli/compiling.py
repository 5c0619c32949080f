# SPDX-License-Identifier: Apache-2.0
"""Whether kernels are being compiled: a command says so only if they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["when_compiling"]

ONCE = "compiling kernels: once for each environment and version of oddsmap"
EACH_TIME = "compiling kernels, each time: set NUMBA_CACHE_DIR to a folder to keep them in"


@contextmanager
def when_compiling(say: Callable[[str], None]) -> Iterator[None]:
    """Call `say` with what to tell the user as soon as a kernel is compiled, once.

    Machine code from the disk is loaded without a word.
    """
    from numba.core import event

    class Listener(event.Listener):
        said = False

        def on_start(self, started: Any) -> None:
            if not self.said:
                self.said = True
                cache = getattr(started.data["dispatcher"], "_cache", None)
                say(ONCE if getattr(cache, "is_kept", False) else EACH_TIME)

        def on_end(self, ended: Any) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield
