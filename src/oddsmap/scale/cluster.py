# SPDX-License-Identifier: Apache-2.0
"""A Dask cluster that is asked, and every way in which it fails, said in one line."""

from __future__ import annotations

import errno
import queue
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from oddsmap.errors import InputError, OddsmapError, OutputError
from oddsmap.scale import worker_versions
from oddsmap.scale.answers import Refusal
from oddsmap.scale.log_source import close_logs
from oddsmap.scale.map_places import Place
from oddsmap.scale.marked_place import check_marked, mark
from oddsmap.scale.worker_versions import check_versions, versions_here

if TYPE_CHECKING:
    from distributed import Client, Future

__all__ = ["Cluster"]

# How long workers are waited for, at the start and when all are gone [s].
PATIENCE_S = 30.0
_LOOK_EVERY_S = 2.0
# Tries of a task whose store or machine fails; a worker that dies counts apart.
_RETRIES = 2
# What Dask raises where the scheduler is out of reach.
_GONE = (OSError, TimeoutError, RuntimeError, CancelledError)
_WORDS = 300
_SMALLER = "make chunks smaller (chunk_scans, --chunk-scans), or let fewer workers share a machine"
_LOST = "the scheduler is gone; nothing of the map is changed: start it again, and the build"


class Cluster:
    """A client of a cluster whose workers can do the work.

    Args:
        client: of Dask.
        name: of the cluster, for messages.

    Raises:
        InputError: it has no workers, or one with other versions.
    """

    def __init__(self, client: Client, name: str) -> None:
        self.client, self.name = client, name
        self.versions = versions_here()
        self._futures: list[Future[Any]] = []
        self._about: dict[str, str] = {}
        self._alone_since: float | None = None
        self._wait_for_workers()
        for worker, found in self.ask_all(worker_versions.versions_here).items():
            check_versions(found, self.versions, worker)

    @property
    def threads(self) -> int:
        """How many tasks run at the same time."""
        return max(1, sum(int(n) for n in self.client.nthreads().values()))

    def _wait_for_workers(self) -> None:
        end = time.monotonic() + PATIENCE_S
        while not self.client.nthreads():
            if time.monotonic() > end:
                raise InputError(
                    f"{self.name}: the cluster has no workers, after {PATIENCE_S:g} s: start "
                    "some (dask worker ADDRESS)"
                )
            time.sleep(0.1)

    def ask_all(self, function: Callable[..., Any], *args: object) -> dict[str, Any]:
        """Call a function on each worker; answers by the worker's address.

        Raises:
            InputError: it fails on one of them.
        """
        try:
            answers = self.client.run(function, *args, on_error="return")
            there = self.client.nthreads()
        except _GONE:
            raise InputError(f"{self.name}: {_LOST}") from None
        for worker, answer in answers.items():
            if isinstance(answer, OddsmapError):
                raise answer
            # One that has died meanwhile is no loss: others do its work.
            if isinstance(answer, BaseException) and worker in there:
                raise InputError(f"worker {worker} {_cannot(answer)}")
        return {worker: answers[worker] for worker in answers if worker in there}

    def check_place(self, place: Place, folder: str) -> None:
        """See that each worker there is sees what is written here; tasks look again.

        Raises:
            InputError: one does not.
        """
        mark(place, folder)
        self.ask_all(check_marked, place, folder)

    def submit(
        self, name: str, function: Callable[..., Any], *args: object, about: str = ""
    ) -> Future[Any]:
        """Begin a task.

        Args:
            name: its own, no other task's of this or of another run.
            function: what is done; it gets the versions, and the arguments.
            args: of the function.
            about: what it is about, for messages; default: its name.
        """
        try:
            future = self.client.submit(
                function, self.versions, *args, key=f"oddsmap-{name}", retries=_RETRIES, pure=False
            )
        except Exception as error:
            if self.client.status == "running":
                raise
            raise InputError(f"{self.name}: {_LOST}") from error
        self._futures.append(future)
        self._about[str(future.key)] = about or name
        return future

    def results(self, futures: Sequence[Future[Any]]) -> Iterator[tuple[int, Any]]:
        """Numbers and results of tasks, as they are done.

        Raises:
            OddsmapError: a task was refused, or the cluster failed.
        """
        done: queue.SimpleQueue[tuple[int, Any, BaseException | None]] = queue.SimpleQueue()

        def fetch(future: Future[Any], number: int) -> None:
            # In a thread of Dask's: where a worker dies with a result, it waits until another has
            # made it again.
            try:
                done.put((number, future.result(), None))
            except BaseException as error:
                done.put((number, None, error))

        for number, future in enumerate(futures):
            future.add_done_callback(partial(fetch, number=number))
        for _ in futures:
            while True:
                try:
                    number, result, error = done.get(timeout=_LOOK_EVERY_S)
                    break
                except queue.Empty:
                    self._look_after()
            self._alone_since = None
            yield number, self._checked(futures[number], result, error)

    def _look_after(self) -> None:
        """See that somebody works, or has not been away for long."""
        if self.client.status != "running":
            raise InputError(f"{self.name}: {_LOST}")
        try:
            found = self.client.scheduler_info()
        except _GONE:
            raise InputError(f"{self.name}: {_LOST}") from None
        workers = found["workers"].values()
        # Some versions of Dask list the first few alone.
        if found.get("n_workers", 0) > len(workers) or any(map(_can_work, workers)):
            self._alone_since = None
        elif self._alone_since is None:
            self._alone_since = time.monotonic()
        elif time.monotonic() - self._alone_since > PATIENCE_S:
            if not workers:
                raise InputError(
                    f"{self.name}: all workers are gone for {PATIENCE_S:g} s; nothing of the map "
                    "is changed: start some, and the build again"
                )
            raise InputError(
                f"{self.name}: all workers have paused for {PATIENCE_S:g} s, for lack of memory; "
                f"nothing of the map is changed: {_SMALLER}"
            )

    def _checked(self, future: Future[Any], result: Any, error: BaseException | None) -> Any:
        """A result, or what is to be said instead."""
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        about = self._about[str(future.key)]
        if isinstance(error, KilledWorker):
            raise InputError(
                f"{about}: {error.allowed_failures + 1} workers in turn died of it, the last was "
                f"{error.last_worker.address}: probably for lack of memory; {_SMALLER}"
            )
        lost = isinstance(error, CancelledError | FutureCancelledError)
        if lost or (error is not None and self.client.status != "running"):
            raise InputError(f"{self.name}: {_LOST}")
        if isinstance(error, OddsmapError):
            raise error
        if isinstance(error, OSError):
            raise OutputError(
                f"{about}: a worker cannot read or write what it needs: {_of_system(error)}"
            ) from error
        if error is not None:
            raise InputError(f"{about}: a worker {_cannot(error)}") from error
        if isinstance(result, Refusal):
            raise result.to_error()
        return result

    def forget(self, futures: Sequence[Future[Any]]) -> None:
        """Let the cluster forget results."""
        for future in futures:
            future.release()

    def close(self) -> None:
        """Stop what is still being done, and let go of logs."""
        with suppress(Exception):
            self.client.cancel(self._futures, force=True)
            self.client.run(close_logs, on_error="ignore")
        self._futures.clear()


def _can_work(worker: Mapping[str, Any]) -> bool:
    """Whether a worker, as the scheduler knows it, works, or would; one that has paused does not.

    Dask lets a worker begin nothing from 80 % of its memory on, and that may never be less again.
    """
    counts = worker.get("metrics", {}).get("task_counts", {})
    return bool(worker.get("status") != "paused" or counts.get("executing"))


def _cannot(error: BaseException) -> str:
    """What a worker cannot do, for lack of what."""
    text = " ".join(str(error).split())
    # Where a task cannot even be unpacked, Dask gives the error's text alone.
    if missing := re.search(r"No module named '([^']+)'", text):
        return f"lacks {missing[1]}: install oddsmap there, of the same version, with what it needs"
    if isinstance(error, ImportError):
        return f"cannot load oddsmap ({text}): install it there as it is here"
    return f"failed: {type(error).__name__}: {text[:_WORDS]}"


def _of_system(error: OSError) -> str:
    what = error.strerror or " ".join(str(error).split())
    where = f" ({error.filename})" if error.filename else ""
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    said = f"{what[:_WORDS]}{where}; nothing of the map is changed"
    return f"{said}: free some disk there, and build again" if full else said
