# SPDX-License-Identifier: Apache-2.0
"""Workers that are processes: the same bits, also where one is killed; and what goes wrong."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from oddsmap import InputError, build_map, open_log, scale
from oddsmap.scale import cluster as clusters
from oddsmap.scale import reaching, worker_versions
from oddsmap.scale.worker_versions import Versions, check_versions
from tests.cli.conftest import Run
from tests.cli.conftest import run as run  # a fixture
from tests.scale.conftest import files_of

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")


@pytest.fixture(scope="module")
def processes() -> Iterator[Any]:
    """A client of two workers, each a process of this machine."""
    with reaching.cluster_of("local", 2) as cluster:
        yield cluster.client


def killed_at(client: Any, scans: int) -> Callable[[int], None]:
    """Progress that kills a worker once so many scans are done."""
    pids = list(client.run(os.getpid).values())

    def progress(done: int) -> None:
        if done >= scans and pids:
            os.kill(pids[0], signal.SIGKILL)
            pids.clear()

    return progress


def test_a_worker_is_killed(processes: Any, clouds: Path, tmp_path: Path) -> None:
    one, many = tmp_path / "one.zarr", tmp_path / "many.zarr"
    build_map(open_log(clouds), 0.25).save(one)
    scale.build(
        clouds, 0.25, output=many, client=processes, chunk_scans=2,
        progress=killed_at(processes, 4),
    )  # fmt: skip
    assert files_of(many) == files_of(one)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_store_that_workers_do_not_see(processes: Any, clouds: Path) -> None:
    """memory:// is each process's own."""
    with pytest.raises(InputError, match="does not see it as it is here: give an output that"):
        scale.build(clouds, 0.25, output="memory://m.zarr", client=processes)


def test_other_versions(
    processes: Any, clouds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = worker_versions.versions_here()
    other = dataclasses.replace(here, numba="0.1")
    monkeypatch.setattr(clusters, "versions_here", lambda: other)
    with pytest.raises(InputError) as error:
        scale.build(clouds, 0.25, output=tmp_path / "m.zarr", client=processes)
    assert f"has numba {here.numba} (here 0.1): it may give other bits" in str(error.value)
    with pytest.raises(InputError, match=r"oddsmap 9 \(here .*\), machine z \(here"):
        check_versions(dataclasses.replace(here, oddsmap="9", machine="z"), here, "w")
    assert isinstance(here, Versions)


def test_no_scheduler(run: Run, clouds: Path, tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    reaching._CONNECT_S, before = 1.0, reaching._CONNECT_S
    try:
        line = run(
            "build", clouds, "--resolution", 0.25, "--dask", address, "-o", tmp_path / "m.zarr"
        ).line
    finally:
        reaching._CONNECT_S = before
    assert line.startswith(f"{address}: no Dask scheduler answers")
    assert list(tmp_path.iterdir()) == []


def test_no_workers(tmp_path: Path, clouds: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clusters, "PATIENCE_S", 0.2)
    with (
        distributed.LocalCluster(
            n_workers=0, processes=False, dashboard_address=":0", silence_logs=50
        ) as empty,
        distributed.Client(empty, set_as_default=False) as client,
        pytest.raises(InputError, match=r"the cluster has no workers, after 0\.2 s"),
    ):
        scale.build(clouds, 0.25, output=tmp_path / "m.zarr", client=client)


@pytest.mark.slow
def test_the_command(run: Run, drives: list[Path], clouds: Path, tmp_path: Path) -> None:
    words = ("--resolution", 0.25, "-o")
    one = run("build", clouds, *words, tmp_path / "one.zarr", "--json").json
    done = run(
        "build", clouds, *words, tmp_path / "two.zarr", "--json", "--dask", "local",
        "--threads", 1, "--chunk-scans", 4,
    )  # fmt: skip
    many = done.json
    assert files_of(tmp_path / "two.zarr") == files_of(tmp_path / "one.zarr")
    assert done.err == ""
    for name in ("scans", "beams", "skipped", "hits", "passes", "cells_known", "volume_m3",
                 "own_votes_predicted"):  # fmt: skip
        assert many[name] == one[name], name
    assert (many["workers"], many["chunks"]) == (1, 3)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--hold-out", 0.1, "--dask", "local"], "--hold-out works on one machine: leave out"),
        (["--auto", "--dask", "local"], "--auto works on one machine"),
        (["--estimator", "full-map", "--dask", "local"], "--estimator full-map works on one"),
        (["--chunk-scans", 5], "--chunk-scans is what a worker takes at a time: add --dask"),
    ],
)
def test_what_does_not_go_together(
    run: Run, clouds: Path, tmp_path: Path, words: list[object], said: str
) -> None:
    line = run("build", clouds, "--resolution", 1, "-o", tmp_path / "m.zarr", *words).line
    assert line.startswith(said)
    url = run("build", clouds, "--resolution", 1, "-o", "s3://a/m.zarr").line
    assert url.startswith("s3://a/m.zarr: maps at URLs are written by workers: add --dask")


def test_bad_calls(clouds: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.zarr"
    with pytest.raises(InputError, match="logs are given as paths, which the workers open"):
        scale.build([open_log(clouds)], 0.25, output=out)  # type: ignore[list-item]
    with pytest.raises(InputError, match="give the path of one"):
        scale.build([], 0.25, output=out)
    with pytest.raises(ValueError, match="workers: at least 1 is needed, got 0"):
        scale.build(clouds, 0.25, output=out, workers=0)


@pytest.mark.slow
def test_what_a_client_that_is_killed_leaves(processes: Any, clouds: Path, tmp_path: Path) -> None:
    """The old map stays, and the next run clears the rest."""
    out = tmp_path / "m.zarr"
    build_map(open_log(clouds), 0.5).save(out)
    old = files_of(out)
    address = processes.scheduler.address
    done = subprocess.run(
        [sys.executable, "-c", _KILLED, str(clouds), str(out), address], check=False
    )
    assert done.returncode == -signal.SIGKILL
    assert files_of(out) == old
    with pytest.warns(UserWarning, match="what a killed run left of its output"):
        scale.build(clouds, 0.25, output=out, client=processes, force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["m.zarr"]
    assert json.loads((out / "zarr.json").read_text())["attributes"]["resolution"] == 0.25


_KILLED = """
import os, signal, sys
from oddsmap import scale
scale.build(sys.argv[1], 0.25, output=sys.argv[2], client=sys.argv[3], chunk_scans=2, force=True,
            progress=lambda done: os.kill(os.getpid(), signal.SIGKILL))
"""
