# SPDX-License-Identifier: Apache-2.0
"""What may go wrong with a cluster: one line each, and the old map stays."""

from __future__ import annotations

import dataclasses
import errno
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from oddsmap import InputError, OutputError, build_map, open_log, scale
from oddsmap.map_files.zarr_folder import NewFolder
from oddsmap.scale import answers, log_source, reaching, worker_versions
from oddsmap.scale import cluster as clusters
from oddsmap.scale.map_places import LocalPlace
from oddsmap.scale.worker_versions import versions_here
from tests.cli.conftest import Run
from tests.cli.conftest import run as run  # a fixture
from tests.scale.conftest import files_of

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def old(clouds: Path, tmp_path: Path) -> Iterator[Path]:
    """A saved map, that has to be there, as it was and alone, after what goes wrong."""
    folder = tmp_path / "maps"
    folder.mkdir()
    build_map(open_log(clouds), 0.5).save(folder / "m.zarr")
    before = files_of(folder / "m.zarr")
    yield folder / "m.zarr"
    assert files_of(folder / "m.zarr") == before
    assert [path.name for path in folder.iterdir()] == ["m.zarr"]


# Nobody there, or somebody else.


def answering_with(content: bytes) -> str:
    """The address of what says the same to all that come; "" listens and says nothing."""
    listening = socket.create_server(("127.0.0.1", 0))

    def answer() -> None:
        kept = []
        with suppress(OSError):
            while True:
                kept.append(listening.accept()[0])
                kept[-1].sendall(content)

    threading.Thread(target=answer, daemon=True).start()
    return f"tcp://127.0.0.1:{listening.getsockname()[1]}"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "nothing that Dask understands was said in 0.5 s"),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", ""),
        (b"SSH-2.0-OpenSSH_9.6\r\n", "what answers speaks something else"),
        (bytes(4096), "what answers speaks something else"),
        (b"\xff" * 4096, "what answers speaks something else"),
        ("no port", "missing port number in address 'no port'"),
        ("http://127.0.0.1:80", "unknown address scheme 'http'"),
    ],
    ids=lambda each: str(each)[:12],
)
def test_no_scheduler_but_something_else(
    run: Run, clouds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    content: bytes | str, said: str,
) -> None:  # fmt: skip
    monkeypatch.setattr(reaching, "_CONNECT_S", 0.5)
    address = content if isinstance(content, str) else answering_with(content)
    out = tmp_path / "m.zarr"
    line = run("build", clouds, "--resolution", 0.25, "--dask", address, "-o", out).line
    assert line.startswith(f"{address}: no Dask scheduler answers ({said}")
    assert "give the address that `dask scheduler` prints" in line
    assert list(tmp_path.iterdir()) == []


def test_the_address_of_a_worker(
    run: Run, clouds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reaching, "_CONNECT_S", 20.0)
    with distributed.LocalCluster(
        n_workers=1, processes=False, protocol="tcp", dashboard_address=":0", silence_logs=50
    ) as cluster:
        (address,) = cluster.scheduler.workers
        out = tmp_path / "m.zarr"
        line = run("build", clouds, "--resolution", 0.25, "--dask", address, "-o", out).line
    assert line.startswith(f"{address}: no Dask scheduler answers (it is a Worker): give")


# What workers do not have, or not as others do.


def test_a_log_that_differs_between_workers(
    threads_of_dask: Any, clouds: Path, old: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One sees a scan less than the first one saw."""
    shorter, opened = tmp_path / "shorter", list[str]()
    shorter.mkdir()
    for file in clouds.iterdir():
        if file.name != "000009.pcd":
            lines = file.read_bytes()
            if file.suffix == ".txt":
                lines = b"".join(lines.splitlines(keepends=True)[:9])
            (shorter / file.name).write_bytes(lines)

    def differs(path: str, **reading: Any) -> Any:
        opened.append(path)
        return open_log(clouds if len(opened) == 1 else shorter, **reading)

    monkeypatch.setattr(log_source, "open_log", differs)
    with pytest.raises(InputError) as error:
        scale.build(
            clouds, 0.25, output=old, client=threads_of_dask, chunk_scans=1, force=True,
        )  # fmt: skip
    assert str(error.value).startswith(f"{clouds}: has 9 scans on worker ")
    assert "and 10 on another: give all workers the same log, and let it be" in str(error.value)


def test_other_versions_that_come_late(
    threads_of_dask: Any, clouds: Path, old: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """When the build began, each worker had the right ones."""
    here = versions_here()
    monkeypatch.setattr(answers, "versions_here", lambda: dataclasses.replace(here, numpy="0.9"))
    with pytest.raises(InputError, match=rf"^worker .* has numpy 0\.9 \(here {here.numpy}\): it"):
        scale.build(clouds, 0.25, output=old, client=threads_of_dask, force=True)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (
            ModuleNotFoundError("No module named 'oddsmap'", name="oddsmap"),
            "lacks oddsmap: install",
        ),
        # So Dask says that what it was given cannot be unpacked.
        (Exception("ModuleNotFoundError(\"No module named 'oddsmap'\")"), "lacks oddsmap: install"),
        (ImportError("Numba needs NumPy 1.22"), "cannot load oddsmap (Numba needs NumPy 1.22): "),
        (RuntimeError("two\nlines"), "failed: RuntimeError: two lines"),
    ],
    ids=lambda each: type(each).__name__,
)
def test_workers_that_cannot_even_begin(
    threads_of_dask: Any, clouds: Path, old: Path, monkeypatch: pytest.MonkeyPatch,
    error: Exception, said: str,
) -> None:  # fmt: skip
    def fails(*_: object) -> None:
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(worker_versions, "versions_here", fails)
        with pytest.raises(InputError, match=rf"^worker inproc://\S+ {re.escape(said)}"):
            scale.build(clouds, 0.25, output=old, client=threads_of_dask, force=True)
    monkeypatch.setattr(answers, "versions_here", fails)
    with pytest.raises(InputError, match=rf"^{clouds}: a worker {re.escape(said)}") as found:
        scale.build(clouds, 0.25, output=old, client=threads_of_dask, force=True)
    assert "\n" not in str(found.value)


def test_a_full_disk_of_a_worker(
    threads_of_dask: Any, clouds: Path, old: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put = LocalPlace.put
    for part, about in (("parts/3-", f"{clouds}: scan 3: "), ("/hits/c/", "write-m.zarr")):

        def full(self: LocalPlace, name: str, content: bytes, part: str = part) -> None:
            if part in name:
                raise OSError(errno.ENOSPC, "No space left on device", name)
            put(self, name, content)

        with monkeypatch.context() as patch:
            patch.setattr(LocalPlace, "put", full)
            with pytest.raises(OutputError) as error:
                scale.build(
                    clouds, 0.25, output=old, client=threads_of_dask, chunk_scans=1, force=True
                )
        line = str(error.value)
        assert line.startswith(about), line
        assert "a worker cannot read or write what it needs: No space left on device (" in line
        assert line.endswith(
            "; nothing of the map is changed: free some disk there, and build again"
        )


def test_a_full_disk_of_the_client(
    threads_of_dask: Any, clouds: Path, old: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    for where, name in ((NewFolder, "create"), (NewFolder, "_write_axes")):
        with monkeypatch.context() as patch:
            patch.setattr(where, name, full)
            with pytest.raises(OutputError, match=r"m\.zarr: cannot be written: No space left on"):
                scale.build(clouds, 0.25, output=old, client=threads_of_dask, force=True)


# Who goes.


class Machines:
    """A scheduler and workers that are processes, to be killed.

    Args:
        folder: for what they leave.
        settings: of Dask.
    """

    def __init__(self, folder: Path, **settings: object) -> None:
        own = {f"DASK_DISTRIBUTED__{name}": str(value) for name, value in settings.items()}
        self._environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}:{ROOT}", **own}
        self._folder, self.workers = folder, list[subprocess.Popen[bytes]]()
        self._up = folder / "scheduler.json"
        self.scheduler = self._start(
            "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
            "--dashboard-address", ":0", "--scheduler-file", str(self._up),
        )  # fmt: skip
        self.start_worker()
        while not self._up.exists():
            time.sleep(0.05)
        with distributed.Client(scheduler_file=self._up, set_as_default=False) as client:
            client.wait_for_workers(1)
            self.address = str(client.scheduler.address)

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", *words], env=self._environment, cwd=self._folder,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def start_worker(self) -> None:
        """One more, which waits for the scheduler."""
        self.workers.append(
            self._start(
                "distributed.cli.dask_worker",
                "--scheduler-file",
                str(self._up),
                "--nthreads",
                "1",
                "--no-nanny",
                "--no-dashboard",
                "--local-directory",
                str(self._folder / "worker"),
            )
        )

    def kill_workers(self) -> None:
        """SIGKILL."""
        for worker in self.workers:
            worker.kill()
            worker.wait()
        self.workers.clear()

    def end(self) -> None:
        """All of it."""
        self.kill_workers()
        self.scheduler.kill()
        self.scheduler.wait()


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[Callable[..., Machines]]:
    """Starts a scheduler and a worker, which end with the test."""
    running = list[Machines]()

    def start(**settings: object) -> Machines:
        folder = tmp_path / "machines"
        folder.mkdir()
        running.append(Machines(folder, **settings))
        return running[0]

    yield start
    for each in running:
        each.end()


def at(scans: int, act: Callable[[], None]) -> Callable[[int], None]:
    """Progress that does something once, when so many scans are done."""
    left = [act]

    def progress(done: int) -> None:
        if done >= scans and left:
            left.pop()()

    return progress


@pytest.mark.slow
def test_the_scheduler_dies(
    machines: Callable[..., Machines], clouds: Path, old: Path, capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    import dask

    cluster = machines()
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "2s"}),
        pytest.raises(InputError, match=r"tcp://.*: the scheduler is gone; nothing of the map is"),
    ):
        scale.build(
            clouds, 0.25, output=old, client=cluster.address, chunk_scans=1, force=True,
            progress=at(3, cluster.scheduler.kill),
        )  # fmt: skip
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_all_workers_are_killed_and_none_comes(
    machines: Callable[..., Machines], clouds: Path, old: Path, capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    cluster = machines()
    monkeypatch.setattr(clusters, "PATIENCE_S", 3.0)
    with pytest.raises(InputError, match="all workers are gone for 3 s; nothing of the map is"):
        scale.build(
            clouds, 0.25, output=old, client=cluster.address, chunk_scans=1, force=True,
            progress=at(3, cluster.kill_workers),
        )  # fmt: skip
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_all_workers_are_killed_and_another_comes(
    machines: Callable[..., Machines], clouds: Path, tmp_path: Path
) -> None:
    cluster, one, many = machines(), tmp_path / "one.zarr", tmp_path / "many.zarr"

    def change() -> None:
        cluster.kill_workers()
        cluster.start_worker()

    scale.build(
        clouds, 0.25, output=many, client=cluster.address, chunk_scans=1, progress=at(3, change)
    )
    build_map(open_log(clouds), 0.25).save(one)
    assert files_of(many) == files_of(one)


@pytest.mark.slow
def test_scans_that_take_workers_down(machines: Callable[..., Machines]) -> None:
    """Here the first worker is enough, and it ends itself."""
    dask = machines(SCHEDULER__ALLOWED_FAILURES=0)
    with reaching.cluster_of(dask.address, 1) as cluster:
        task = cluster.submit("chunk-7", lambda _: os._exit(9), about="room: scans 10 to 19")
        with pytest.raises(InputError) as error:
            list(cluster.results([task]))
    line = str(error.value)
    assert line.startswith("room: scans 10 to 19: 1 workers in turn died of it, the last was tcp:")
    assert "probably for lack of memory; make chunks smaller (chunk_scans, --chunk-scans)" in line


def test_workers_that_have_paused(
    threads_of_dask: Any, clouds: Path, old: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As Dask lets them where their memory is nearly full, which here is said to be small."""
    monkeypatch.setattr(clusters, "PATIENCE_S", 0.5)
    monkeypatch.setattr(clusters, "_LOOK_EVERY_S", 0.2)
    workers = list(threads_of_dask.cluster.workers.values())

    def pause_from(share: float, status: str) -> None:
        for worker in workers:
            worker.memory_manager.memory_pause_fraction = share
        while {each["status"] for each in threads_of_dask.scheduler_info()["workers"].values()} != {
            status
        }:
            time.sleep(0.05)

    pause_from(1e-5, "paused")
    try:
        with pytest.raises(InputError) as error:
            scale.build(clouds, 0.25, output=old, client=threads_of_dask, force=True)
    finally:
        pause_from(0.8, "running")
    assert "all workers have paused for 0.5 s, for lack of memory; nothing of the map is" in str(
        error.value
    )


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="needs signals of POSIX")
def test_an_interrupt_reaches_the_command_alone(clouds: Path, old: Path) -> None:
    """As a terminal sends it: to the command and to all processes that it has started."""
    going = subprocess.Popen(
        [sys.executable, "-m", "oddsmap", "build", str(clouds), "--resolution", "0.05", "-o",
         str(old), "--force", "--dask", "local", "--threads", "2", "--chunk-scans", "1"],
        env={**os.environ, "PYTHONPATH": f"{ROOT / 'src'}:{ROOT}"}, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while going.poll() is None and not list(old.parent.glob(".oddsmap-*/new/*.parts/*")):
        time.sleep(0.01)
    os.killpg(going.pid, signal.SIGINT)
    out, err = going.communicate(timeout=120)
    assert (going.returncode, out) == (130, "")
    assert err == "oddsmap: interrupted: each output is as it was, or new and complete\n"
    end = time.monotonic() + 30
    while _living(going.pid):
        assert time.monotonic() < end, "workers are left"
        time.sleep(0.05)


def _living(group: int) -> bool:
    words = ["ps", "-e", "-o", "pgid=,stat="]
    listed = subprocess.run(words, capture_output=True, text=True, check=True)
    found = [line.split() for line in listed.stdout.splitlines()]
    return any(own == str(group) and not state.startswith("Z") for own, state in found)
