# SPDX-License-Identifier: Apache-2.0
"""Killed before each call of the system, one after the other: the old output or the new one."""

from __future__ import annotations

import os
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import EvidenceMap
from oddsmap.atomic_write import atomic_output, swap
from tests.cli.conftest import folder_bytes
from tests.kills_kit import FORK, Content, copied, left_by
from tests.saved_maps_kit import KINDS

_STEPS = {"open", "os.rename", "os.mkdir", "os.remove", "os.rmdir", "os.link", "os.scandir"}


def killed_at(step: int, replace: Callable[[], object], folder: Path, exchange: bool) -> None:
    """Replace an output in a process that kills itself before its step'th call of the system."""
    count = 0

    def watch(event: str, args: tuple[Any, ...]) -> None:
        nonlocal count
        if event not in _STEPS or str(folder) not in str(args[0]):
            return
        count += 1
        if count == step:
            os.kill(os.getpid(), signal.SIGKILL)

    real = swap._rename

    def rename(source: Path, path: Path, flag: int) -> bool:
        watch("os.rename", (source,))
        done = real(source, path, flag)
        watch("os.rename", (source,))
        return done

    swap._rename = rename
    if not exchange:
        swap._renameat2 = lambda: None  # type: ignore[assignment]
    sys.addaudithook(watch)
    replace()
    os._exit(0)


def at_each_step(
    replace: Callable[[], object], path: Path, restore: Callable[[], None], content: Content, *,
    exchange: bool = True, stride: int = 1,
) -> int:  # fmt: skip
    restore()
    old = content(path)
    replace()
    sides, step = [old, content(path)], 0
    seen: set[int] = set()
    while True:
        step += stride
        restore()
        process = FORK.Process(target=killed_at, args=(step, replace, path.parent, exchange))
        process.start()
        process.join()
        side = left_by(signal.SIGKILL, path, content, sides)
        if process.exitcode == 0:
            assert side == 1
            assert seen == {0, 1}
            return step
        assert process.exitcode == -signal.SIGKILL
        seen.add(side)


def put(path: Path, content: str) -> None:
    with atomic_output(path, force=True, why_not=lambda _: None) as part:
        (part / "hits").mkdir(parents=True)
        for name in ("zarr.json", "hits/0"):
            (part / name).write_text(content)


@pytest.mark.parametrize("exchange", [True, False])
def test_a_folder_is_replaced_in_steps(exchange: bool, tmp_path: Path) -> None:
    path = tmp_path / "m.zarr"
    steps = at_each_step(
        lambda: put(path, "new"),
        path,
        lambda: put(path, "old"),
        folder_bytes,
        exchange=exchange,
    )
    assert steps > 15


@pytest.mark.slow
@pytest.mark.parametrize("exchange", [True, False])
def test_a_map_is_replaced_in_steps(exchange: bool, tmp_path: Path) -> None:
    make, load, content = KINDS["full map"]
    path, grids = tmp_path / "m.zarr", [make(seed) for seed in (1, 2)]
    steps = at_each_step(
        lambda: grids[1].save(path, force=True),
        path,
        lambda: grids[0].save(path, force=True),
        lambda path: content(load(path)),
        exchange=exchange,
    )
    assert steps > 30


@pytest.mark.parametrize("stride", [11, pytest.param(1, marks=pytest.mark.slow)])
def test_a_map_is_added_to_in_steps(stride: int, tmp_path: Path) -> None:
    """With a shard that is written, and some that are linked."""
    make, load, content = KINDS["2D"]
    path, kept = tmp_path / "maps" / "map.zarr", tmp_path / "kept.zarr"
    path.parent.mkdir()
    (make(1) + make(2)).save(kept)
    more = EvidenceMap(0.1, votes="beam")
    more.add_cells(np.array([[2, 2]]), np.array([65536]), np.array([0]))

    def restore() -> None:
        shutil.rmtree(path, ignore_errors=True)
        shutil.copytree(kept, path)

    steps = at_each_step(
        lambda: more.save(path, append=True),
        path,
        restore,
        lambda found: content(load(found)),
        stride=stride,
    )
    assert steps > 40


def test_files_are_replaced_in_steps(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    grid = EvidenceMap(0.1)
    grid.add_cells(np.array([[0, 0], [3, 4]]), np.array([1 << 18, 0]), np.array([0, 1 << 18]))
    view = grid.log_odds()
    steps = at_each_step(
        lambda: view.save_ros(path, force=True),
        path,
        copied({path: b"old", path.with_suffix(".pgm"): b"old"}),
        lambda _: folder_bytes(tmp_path),
    )
    assert steps > 10
