# SPDX-License-Identifier: Apache-2.0
"""What commands show on stderr while they work, where that is a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from oddsmap.cli.compiling import when_compiling

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID

__all__ = [
    "progress_of_fit",
    "progress_of_logs",
    "progress_of_scans",
    "progress_of_sweeps",
    "working",
]

_GETTING_READY = "getting ready"


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

        with when_compiling(_on(bar, task)):
            yield advance


@contextmanager
def progress_of_scans(
    what: str, total: int | None, *, compiles: bool = True, quiet: bool
) -> Iterator[Callable[[int], None]]:
    """A bar on stderr; gives the callback for the number of scans done.

    Args:
        what: what is being done: "scoring".
        total: how many scans there are; None where that is not known.
        compiles: whether kernels are needed.
        quiet: True: no bar.
    """
    with _bar(quiet=quiet) as bar:
        task = bar.add_task(what, total=total)
        listen = when_compiling if compiles else nullcontext
        with listen(_on(bar, task)):
            yield lambda done: bar.update(task, description=what, completed=done)


@contextmanager
def progress_of_sweeps(max_sweeps: int, *, quiet: bool) -> Iterator[Callable[[int, float], None]]:
    """A bar on stderr; gives the callback for a sweep's number and residual."""
    with _bar(quiet=quiet) as bar:
        task = bar.add_task(_GETTING_READY, total=max_sweeps)
        with when_compiling(_on(bar, task)):
            yield lambda sweep, residual: bar.update(
                task,
                description=f"sweeping, messages still move by {residual:.2g}",
                completed=sweep,
            )


@contextmanager
def progress_of_fit(*, quiet: bool) -> Iterator[Callable[[str, float], None] | None]:
    """A line on stderr that changes; gives the callback for it."""
    with working(_GETTING_READY, quiet=quiet) as say:
        yield lambda what, value: say(f"fitting {what}: {value:+.4f} nats per beam")


@contextmanager
def working(what: str, *, compiles: bool = True, quiet: bool) -> Iterator[Callable[[str], None]]:
    """A line on stderr with the time that something of unknown length has taken so far.

    Args:
        what: what is being done: "saving hall.zarr".
        compiles: whether kernels are needed.
        quiet: True: no line.

    Yields:
        What says that something else is being done.
    """
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    console = _console()
    with Progress(
        *columns, console=console, transient=True, disable=quiet or not console.is_terminal
    ) as line:
        task = line.add_task(what, total=None)

        def say(instead: str) -> None:
            line.update(task, description=instead)

        with when_compiling(_on(line, task)) if compiles else nullcontext():
            yield say


def _bar(*, quiet: bool) -> Progress:
    """A bar on stderr, with the time that is left, which is gone when the work is done."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = _console()
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    shown = not quiet and console.is_terminal
    return Progress(*columns, console=console, transient=True, disable=not shown)


def _on(bar: Progress, task: TaskID) -> Callable[[str], None]:
    """What says that kernels are compiled: the sentence stays above the bar."""

    def say(what: str) -> None:
        if not bar.disable:
            bar.console.print(what, markup=False, highlight=False)
        bar.update(task, description="compiling")

    return say


def _console() -> Console:
    from rich.console import Console

    return Console(stderr=True)
