# SPDX-License-Identifier: Apache-2.0
"""What commands show on stderr while they work, where that is a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress

__all__ = ["progress_of_fit", "progress_of_logs", "progress_of_sweeps"]

# The first run compiles for some seconds before the first scan is done.
_GETTING_READY = "getting ready (compiles once a machine)"


@contextmanager
def progress_of_logs(
    total: int | None, *, quiet: bool
) -> Iterator[Callable[[], Callable[[int], None]]]:
    """A bar on stderr; gives a function that makes the callback for the next log.

    Args:
        total: how many scans there are; None where that is not known.
        quiet: True: no bar.
    """
    with _bar(quiet=quiet) as bar:
        task = bar.add_task(_GETTING_READY, total=total)
        done = 0

        def advance() -> Callable[[int], None]:
            before = done

            def of_log(count: int) -> None:
                nonlocal done
                done = before + count
                bar.update(task, description="mapping", completed=done)

            return of_log

        yield advance


@contextmanager
def progress_of_sweeps(max_sweeps: int, *, quiet: bool) -> Iterator[Callable[[int, float], None]]:
    """A bar on stderr; gives the callback for a sweep's number and residual."""
    with _bar(quiet=quiet) as bar:
        task = bar.add_task(_GETTING_READY, total=max_sweeps)
        yield lambda sweep, residual: bar.update(
            task, description=f"sweeping, messages still move by {residual:.2g}", completed=sweep
        )


@contextmanager
def progress_of_fit(*, quiet: bool) -> Iterator[Callable[[str, float], None] | None]:
    """A line on stderr that changes; gives the callback for it."""
    from rich.console import Console

    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    with console.status(_GETTING_READY) as status:
        yield lambda what, value: status.update(f"fitting {what}: {value:+.4f} nats per beam")


def _bar(*, quiet: bool) -> Progress:
    """A bar on stderr that is gone when the work is done."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    shown = not quiet and console.is_terminal
    return Progress(*columns, console=console, transient=True, disable=not shown)
