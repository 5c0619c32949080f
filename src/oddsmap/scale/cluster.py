# SPDX-License-Identifier: Apache-2.0
"""A Dask cluster: reached or started, asked, and every way in which it fails said in one line."""

from __future__ import annotations

import logging
import queue
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from oddsmap.errors import InputError, OddsmapError
from oddsmap.scale import worker_versions
from oddsmap.scale.answers import Refusal
from oddsmap.scale.log_source import close_logs
from oddsmap.scale.map_places import Place
from oddsmap.scale.marked_place import check_marked, mark
from oddsmap.scale.worker_versions import check_versions, versions_here

if TYPE_CHECKING:
    from distributed import Client, Future

__all__ = ["Cluster", "cluster_of"]

# How long workers are waited for, at the start and when all are gone [s].
PATIENCE_S = 30.0
_CONNECT_S = 10.0
_LOOK_EVERY_S = 2.0
# Tries of a task whose store or machine fails; a worker that dies counts apart.
_RETRIES = 2
# Of clusters that end with the command, which nobody watches: what goes wrong is said by us, a
# worker that is killed is no news, and Dask looks at itself less often. By default an idle cluster
# of two takes 12 % of a core, most of it to see every millisecond how long Python's lock is held;
# so it takes 2 %.
_QUIET_CLUSTER = {
    "logging.distributed": "critical",
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.admin.system-monitor.interval": "2s",
    "distributed.admin.tick.interval": "500ms",
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.worker.profile.enabled": False,
}
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
        answers = self.client.run(function, *args, on_error="return")
        for worker, answer in answers.items():
            if isinstance(answer, OddsmapError):
                raise answer
            if isinstance(answer, ImportError):
                raise InputError(
                    f"worker {worker} lacks {answer.name or answer}: install oddsmap there, of the "
                    "same version"
                )
            if isinstance(answer, BaseException):
                raise InputError(f"worker {worker}: {type(answer).__name__}: {answer}")
        return dict(answers)

    def check_place(self, place: Place, folder: str) -> None:
        """See that each worker there is sees what is written here; tasks look again.

        Raises:
            InputError: one does not.
        """
        mark(place, folder)
        self.ask_all(check_marked, place, folder)

    def submit(self, what: str, function: Callable[..., Any], *args: object) -> Future[Any]:
        """Begin a task under a key of its own."""
        future = self.client.submit(
            function, self.versions, *args, key=f"oddsmap-{what}", retries=_RETRIES, pure=False
        )
        self._futures.append(future)
        return future

    def results(self, futures: Sequence[Future[Any]]) -> Iterator[tuple[int, Any]]:
        """Numbers and results of tasks, as they are done.

        Raises:
            OddsmapError: a task was refused, or the cluster failed.
        """
        done: queue.SimpleQueue[int] = queue.SimpleQueue()
        for number, future in enumerate(futures):
            future.add_done_callback(lambda _, number=number: done.put(number))
        alone_since: float | None = None
        for _ in futures:
            while True:
                try:
                    number = done.get(timeout=_LOOK_EVERY_S)
                    break
                except queue.Empty:
                    alone_since = self._look_after(alone_since)
            yield number, self._result(futures[number])

    def _look_after(self, alone_since: float | None) -> float | None:
        """See that somebody works; since when nobody does."""
        if self.client.status != "running":
            raise InputError(f"{self.name}: {_LOST}")
        try:
            workers = self.client.nthreads()
        except (OSError, TimeoutError):
            raise InputError(f"{self.name}: {_LOST}") from None
        if workers:
            return None
        if alone_since is None:
            return time.monotonic()
        if time.monotonic() - alone_since > PATIENCE_S:
            raise InputError(
                f"{self.name}: all workers are gone for {PATIENCE_S:g} s; nothing of the map is "
                "changed: start some, and the build again"
            )
        return alone_since

    def _result(self, future: Future[Any]) -> Any:
        from concurrent.futures import CancelledError

        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        what = str(future.key).removeprefix("oddsmap-")
        try:
            result = future.result()
        except KilledWorker as error:
            raise InputError(
                f"{what}: {error.allowed_failures + 1} workers in "
                f"turn died of it, the last was {error.last_worker.address}: probably for lack of "
                "memory; make chunks smaller (chunk_scans, --chunk-scans), or fewer workers share "
                "a machine"
            ) from None
        except (CancelledError, FutureCancelledError):
            raise InputError(f"{self.name}: {_LOST}") from None
        except OddsmapError:
            raise
        except Exception as error:
            raise InputError(f"{what}: a worker failed: {type(error).__name__}: {error}") from error
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


@contextmanager
def cluster_of(client: Client | str | None, workers: int) -> Iterator[Cluster]:
    """Reach a cluster, or start one.

    Args:
        client: of Dask; the address of a scheduler; "local" or None: processes of this machine,
            which end with the block.
        workers: how many of those.

    Raises:
        InputError: it cannot be reached, or its workers cannot do the work.
    """
    try:
        import distributed  # noqa: F401 - whether it is there
    except ImportError as error:
        missing = (error.name or "distributed").split(".")[0]
        raise InputError(
            f'a cluster needs Dask, and {missing} is missing: pip install "oddsmap[dask]"'
        ) from None
    if client is None or isinstance(client, str):
        name = client or "local"
        made: Client | None = _local(workers) if name == "local" else _at(name)
    else:
        name, made = str(client.scheduler.address if client.scheduler else client), None
    reached: Any = client if made is None else made
    cluster = None
    try:
        cluster = Cluster(reached, name)
        yield cluster
    finally:
        if cluster is not None:
            cluster.close()
        if made is not None:
            with _quiet():
                made.close(timeout=5)
                if name == "local" and made.cluster is not None:
                    made.cluster.close(timeout=5)


def _local(workers: int) -> Client:
    import dask
    from distributed import Client, LocalCluster

    with dask.config.set(_QUIET_CLUSTER):
        cluster = LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        )  # fmt: skip
        return Client(cluster, set_as_default=False)


def _at(address: str) -> Client:
    from distributed import Client

    with _quiet():
        try:
            return Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            why = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(
                f"{address}: no Dask scheduler answers ({why}): give the address that `dask "
                "scheduler` prints, like tcp://10.0.0.1:8786, or local"
            ) from None


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask from saying on stderr what is said here."""
    logger = logging.getLogger("distributed")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)
