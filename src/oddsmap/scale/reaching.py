# SPDX-License-Identifier: Apache-2.0
"""A cluster that is reached at an address, or started on this machine, and left again."""

from __future__ import annotations

import asyncio
import logging
import signal
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from oddsmap.errors import InputError
from oddsmap.scale.cluster import Cluster

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["cluster_of"]

# How long a scheduler has to answer [s].
_CONNECT_S = 10.0
_WORDS = 200
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
    with ExitStack() as undo:
        if client is None or isinstance(client, str):
            name = client or "local"
            undo.enter_context(_quiet())
            reached: Any = _local(workers) if name == "local" else _at(name)
            undo.callback(_close, reached, with_cluster=name == "local")
        else:
            name, reached = str(client.scheduler.address if client.scheduler else client), client
        cluster = Cluster(reached, name)
        undo.callback(cluster.close)
        yield cluster


def _close(client: Client, *, with_cluster: bool) -> None:
    client.close(timeout=5)
    if with_cluster and client.cluster is not None:
        client.cluster.close(timeout=5)


def _local(workers: int) -> Client:
    import dask
    from distributed import Client, LocalCluster

    cluster = None
    try:
        with dask.config.set(_QUIET_CLUSTER), _not_interrupted():
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0",
                silence_logs=logging.CRITICAL,
            )  # fmt: skip
            return Client(cluster, set_as_default=False)
    except BaseException:
        if cluster is not None:
            cluster.close(timeout=5)
        raise


@contextmanager
def _not_interrupted() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach; here it comes when the block ends.

    A terminal sends it to all of them, and each worker would say so with a traceback. They end with
    the cluster. Threads and processes take what is blocked from those that start them.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # which else is started inside, and unblocks it there
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _at(address: str) -> Client:
    from distributed import Client

    try:
        if not address.startswith("inproc://"):  # nobody else could be there
            _check_scheduler(address)
        return Client(address, timeout=_CONNECT_S, set_as_default=False)
    except Exception as error:
        raise InputError(
            f"{address}: no Dask scheduler answers ({_why(error)}): give the address that `dask "
            "scheduler` prints, like tcp://10.0.0.1:8786, or local"
        ) from None


def _check_scheduler(address: str) -> None:
    """Ask who is there: Dask's client waits for minutes, or for ever, for what is no scheduler.

    Raises:
        Exception: of many kinds; there is none.
    """
    failed: list[Exception] = []

    def ask() -> None:
        try:
            who = asyncio.run(asyncio.wait_for(_who_is_at(address), _CONNECT_S + 1.0))
            if who != "Scheduler":
                raise OSError(f"it is a {who}")
        except Exception as error:
            failed.append(error)

    # A thread of its own: in a notebook this one has a loop already.
    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    asking.join(_CONNECT_S + 2.0)
    if failed:
        raise failed[0]
    if asking.is_alive():
        raise TimeoutError


async def _who_is_at(address: str) -> str:
    from distributed.comm.core import connect
    from distributed.security import Security

    access = Security().get_connection_args("client")
    comm = await connect(address, timeout=_CONNECT_S, **access)
    try:
        await comm.write({"op": "identity", "reply": True})
        said = await comm.read()
    finally:
        comm.abort()
    return str(said["type"])[:40]


def _why(error: BaseException) -> str:
    """The first cause of an error, in a few words."""
    while error.__cause__ is not None:
        error = error.__cause__
    if isinstance(error, TimeoutError | asyncio.CancelledError):
        return f"nothing that Dask understands was said in {_CONNECT_S:g} s"
    text = getattr(error, "strerror", None) or " ".join(str(error).split())
    # Of the address, of TLS, of the network; all else comes of unpacking what is no message.
    if isinstance(error, OSError | TypeError) or "address" in text:
        return text[:_WORDS] or type(error).__name__
    return "what answers speaks something else"


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask from saying on stderr what is said here; its parts have levels of their own."""
    names = ["distributed", *logging.getLogger().manager.loggerDict]
    loggers = [logging.getLogger(each) for each in names if each.split(".")[0] == "distributed"]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
