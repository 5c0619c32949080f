# SPDX-License-Identifier: Apache-2.0
"""A map that is replaced while it is read is one map or the other, never a mixture."""

from __future__ import annotations

import multiprocessing
import os
from pathlib import Path
from typing import Any

import pytest

from oddsmap import EvidenceMap, load_map
from oddsmap.atomic_write import swap
from oddsmap.errors import InputError
from oddsmap.evidence import store, stored_tiles
from oddsmap.map_files import zarr_snapshot
from oddsmap.map_files.zarr_header import read_header
from tests.kit import ONE, Votes, add_votes, votes_of
from tests.saved_maps_kit import KINDS

SPAWN = multiprocessing.get_context("spawn")


def write_in_turn(kind: str, path: Path, end: Any, exchange: bool) -> None:
    """A process that saves one map and the other until it is told to stop."""
    if not exchange:
        swap._renameat2 = lambda: None  # type: ignore[assignment]
    grids = [KINDS[kind].make(seed) for seed in (1, 2)]
    saves = 0
    while not end.poll():
        grids[saves % 2].save(path, force=True)
        saves += 1
    end.send(saves)


def read_beside(kind: str, path: Path, loads: int, *, exchange: bool = True) -> tuple[int, int]:
    """How often the map was saved meanwhile, and how many of the loads gave the second one."""
    _, load, content = KINDS[kind]
    grids = [KINDS[kind].make(seed) for seed in (1, 2)]
    expected = [content(grid) for grid in grids]
    grids[0].save(path)
    here, there = SPAWN.Pipe()
    writer = SPAWN.Process(target=write_in_turn, args=(kind, path, there, exchange))
    writer.start()
    try:
        found = [expected.index(content(load(path))) for _ in range(loads)]
        here.send("enough")
        saves: int = here.recv()
    finally:
        writer.join(60)
        writer.kill()
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    return saves, sum(found)


@pytest.mark.parametrize("kind", KINDS)
def test_each_load_is_one_map_or_the_other(kind: str, tmp_path: Path) -> None:
    read_beside(kind, tmp_path / "a.zarr", 10)


def test_so_it_is_where_folders_are_not_exchanged(tmp_path: Path) -> None:
    read_beside("full map", tmp_path / "a.zarr", 10, exchange=False)


@pytest.mark.slow
@pytest.mark.parametrize("exchange", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_each_of_many_loads(kind: str, exchange: bool, tmp_path: Path) -> None:
    saves, second = read_beside(kind, tmp_path / "a.zarr", 1000, exchange=exchange)
    print(kind, exchange, "saves", saves, "second map", second)  # noqa: T201
    assert saves > 10


# The same in one process, with the writer at the worst moment.


def a_map(votes: Votes) -> EvidenceMap:
    grid = EvidenceMap(0.5)
    add_votes(grid, votes)
    return grid


ONE_MAP: Votes = {(1, 1): (ONE, 0), (1, 2000): (ONE, ONE)}
OTHER: Votes = {(-5000, 1): (3 * ONE, ONE), (-5000, 2000): (0, ONE), (7, 7): (0, 9 * ONE)}


@pytest.mark.parametrize(
    ("room", "step"),
    [(store, "read_header"), (store, "SavedShards"), (stored_tiles, "check_counts")],
    ids=["header", "shards", "counts"],
)
def test_a_map_that_is_replaced_in_between(
    room: Any, step: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.zarr"
    a_map(ONE_MAP).save(path)
    real, times = getattr(room, step), []

    def replaced_before(*args: Any) -> Any:
        times.append(1)
        if len(times) == 1:
            a_map(OTHER).save(path, force=True)
        return real(*args)

    monkeypatch.setattr(room, step, replaced_before)
    assert votes_of(load_map(path)) == OTHER
    assert len(times) > 1


def test_a_map_that_is_replaced_each_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.zarr"
    a_map(ONE_MAP).save(path)
    real, times = read_header, []

    def touched(*args: Any) -> Any:
        times.append(1)
        os.utime(path / "zarr.json", ns=(len(times), len(times)))
        return real(*args)

    monkeypatch.setattr(store, "read_header", touched)
    monkeypatch.setattr(zarr_snapshot, "_TRIES", 5)
    with pytest.raises(InputError, match=r"a\.zarr: was replaced each of the 5 times that it was"):
        load_map(path)
    assert len(times) == 5


def test_arrays_of_another_save(tmp_path: Path) -> None:
    """A folder that was put together of two maps is neither."""
    for name, votes in (("a.zarr", ONE_MAP), ("b.zarr", ONE_MAP)):
        a_map(votes).save(tmp_path / name)
    (tmp_path / "b.zarr" / "hits").rename(tmp_path / "hits")
    (tmp_path / "a.zarr" / "hits").rename(tmp_path / "b.zarr" / "hits")
    with pytest.raises(InputError, match="damaged"):
        load_map(tmp_path / "b.zarr")
