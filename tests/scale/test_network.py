# SPDX-License-Identifier: Apache-2.0
"""A cluster over real sockets: its machines are network namespaces with addresses of their own.

The folder that the command runs in is hidden from the workers: they share the logs and the store.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from oddsmap import build_map, open_log
from tests.scale.conftest import files_of

pytest.importorskip("distributed")
pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
NAMES = ("oddsmap-client", "oddsmap-one", "oddsmap-two")
HOSTS = ("10.177.0.1", "10.177.0.2", "10.177.0.3")


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)  # noqa: S607


@pytest.fixture
def machines() -> Iterator[tuple[str, ...]]:
    """Three network namespaces on one bridge; skips where they cannot be made."""
    if shutil.which("ip") is None or shutil.which("unshare") is None:
        pytest.skip("no network namespaces: needs ip and unshare")
    with ExitStack() as undo:
        try:
            for name in NAMES:
                ip("netns", "add", name)
                undo.callback(ip, "netns", "delete", name)
                ip("-n", name, "link", "set", "lo", "up")
            ip("-n", NAMES[0], "link", "add", "bridge0", "type", "bridge")
            ip("-n", NAMES[0], "addr", "add", f"{HOSTS[0]}/24", "dev", "bridge0")
            ip("-n", NAMES[0], "link", "set", "bridge0", "up")
            for number in (1, 2):
                here, there = f"om{number}a", f"om{number}b"
                ip("-n", NAMES[0], "link", "add", here, "type", "veth", "peer", "name", there,
                   "netns", NAMES[number])  # fmt: skip
                ip("-n", NAMES[0], "link", "set", here, "master", "bridge0", "up")
                ip("-n", NAMES[number], "addr", "add", f"{HOSTS[number]}/24", "dev", there)
                ip("-n", NAMES[number], "link", "set", there, "up")
        except (OSError, subprocess.CalledProcessError) as error:
            why = getattr(error, "stderr", None) or error
            pytest.skip(f"no network namespaces can be made here: {why}".strip())
        yield NAMES


def test_machines_that_share_only_a_store(
    machines: tuple[str, ...], clouds: Path, tmp_path: Path
) -> None:
    own, store, up = tmp_path / "own", tmp_path / "store", tmp_path / "scheduler.json"
    own.mkdir()
    store.mkdir()
    environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}:{ROOT}"}
    address = f"tcp://{HOSTS[0]}:8786"
    running: list[subprocess.Popen[bytes]] = []

    def start(machine: str, *words: str, hidden: Path | None = None) -> None:
        command = ["ip", "netns", "exec", machine]
        if hidden is not None:
            mounted = f'mount -t tmpfs none "{hidden}" && exec "$@"'
            command += ["unshare", "--mount", "sh", "-c", mounted, "sh"]
        quiet = subprocess.DEVNULL
        whole = [*command, sys.executable, "-m", *words]
        running.append(
            subprocess.Popen(whole, env=environment, stdout=quiet, stderr=quiet, cwd=tmp_path)
        )

    try:
        start(machines[0], "distributed.cli.dask_scheduler", "--host", HOSTS[0], "--port", "8786",
              "--dashboard-address", ":0", "--scheduler-file", str(up))  # fmt: skip
        for number in (1, 2):
            start(machines[number], "distributed.cli.dask_worker", address, "--nthreads", "1",
                  "--host", HOSTS[number], "--no-dashboard", "--no-nanny",
                  "--local-directory", str(tmp_path / f"worker{number}"), hidden=own)  # fmt: skip
        end = time.monotonic() + 120
        while not up.exists():
            assert time.monotonic() < end, "the scheduler does not start"
            time.sleep(0.1)
        out = store / "map.zarr"
        build = [sys.executable, "-m", "oddsmap", "build", str(clouds), "--resolution", "0.25",
                 "--dask", address, "--chunk-scans", "3"]  # fmt: skip
        for target, status in ((out, 0), (own / "map.zarr", 1)):
            done = subprocess.run(
                ["ip", "netns", "exec", machines[0], *build, "-o", str(target)],  # noqa: S607
                env=environment, cwd=own, capture_output=True, text=True, check=False,
            )  # fmt: skip
            assert done.returncode == status, done.stderr
        assert "does not see it as it is here: give an output that all workers share" in done.stderr
        assert done.stderr.count("\n") == 1
        assert list(own.iterdir()) == []
    finally:
        for process in running:
            process.kill()
        for process in running:
            process.wait(20)
    one = tmp_path / "one.zarr"
    build_map(open_log(clouds), 0.25).save(one)
    assert files_of(out) == files_of(one)
