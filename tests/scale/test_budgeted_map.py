# SPDX-License-Identifier: Apache-2.0
"""Maps that are built within a budget of memory: to the bit those that are built in memory."""

from __future__ import annotations

import errno
import json
import multiprocessing
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap
from oddsmap import BeamSensor, ConeSensor, EvidenceMap, MapTooLargeError, OutputError
from oddsmap.errors import RecoveryWarning
from oddsmap.evidence.tile_rows import add_rows, rows_of
from oddsmap.evidence.tiles import TileStore
from oddsmap.integrate.add import add_scans
from oddsmap.kernels.units import MAX_UNITS
from oddsmap.posterior.count_pairs import TotalsWithPairs, count_pairs
from oddsmap.scale import tile_runs
from oddsmap.scale.budgeted_map import BudgetedMap
from tests import memory_kit
from tests.kit import AS_FOUND, ONE

KINDS: dict[str, tuple[Callable[[], list[Any]], dict[str, Any]]] = {
    "2D": (memory_kit.lidar, {}),
    "2D, beams and lengths": (memory_kit.lidar, {"votes": "beam", "path_lengths": True}),
    "2D, wide hits": (memory_kit.lidar, {"sensor": BeamSensor(hit_width=0.3, share_hit=True)}),
    "2D, cones": (memory_kit.sonar, {"sensor": memory_kit.SONAR}),
    "2D, overhead": (memory_kit.overhead, {"sensor": oddsmap.OverheadSensor()}),
    "2D, half-life": (memory_kit.lidar, {"half_life": 5.0, "t_ref_ns": 3 * 10**10}),
    "3D": (memory_kit.turns, {"ndim": 3}),
    "3D, fading": (memory_kit.turns, {"ndim": 3, "sensor": memory_kit.FADING}),
    "3D, lengths": (memory_kit.turns, {"ndim": 3, "votes": "beam", "path_lengths": True}),
    "3D, cones": (memory_kit.tof, {"ndim": 3, "sensor": ConeSensor(cone_deg=8.0, range_max=3.0)}),
}


def content(path: Path) -> dict[str, Any]:
    """All files of a saved map, without what is another for each save."""
    found: dict[str, Any] = {}
    for file in sorted(path.rglob("*")):
        if file.is_file():
            found[str(file.relative_to(path))] = file.read_bytes()
    for name in [name for name in found if name.endswith("zarr.json")]:
        text = json.loads(found[name])
        for changing in ("save", "digest"):
            text["attributes"].pop(changing, None)
        found[name] = text
    return found


def budgeted(
    scans: list[Any], options: dict[str, Any], path: Path, memory: int, threads: int = 1
) -> tuple[TotalsWithPairs, int]:
    """Build a map in a folder; its totals, and how often it was written to the disk."""
    evidence = EvidenceMap(0.1, **options)
    with BudgetedMap(evidence, path, memory) as building:
        for some in (scans[::2], scans[1::2]):
            add_scans(evidence, some, threads=threads)
        evidence.record("a.log", scans=len(scans))
        totals = building.total(TotalsWithPairs)
        building.save()
        return totals, building.spill_count


@pytest.mark.parametrize("kind", KINDS)
@given(
    memory=st.sampled_from([1, 100_000, 1_000_000, 10_000_000, 10**9]), threads=st.integers(1, 2)
)
@settings(max_examples=3, phases=AS_FOUND)
def test_as_in_memory(
    tmp_path_factory: pytest.TempPathFactory, kind: str, memory: int, threads: int
) -> None:
    make, options = KINDS[kind]
    folder, scans = tmp_path_factory.mktemp("maps"), make()[:24]
    whole = EvidenceMap(0.1, **options)
    add_scans(whole, scans)
    whole.record("a.log", scans=len(scans))
    whole.save(folder / "a.zarr")
    totals, count = budgeted(scans, options, folder / "b.zarr", memory, threads)
    assert content(folder / "b.zarr") == content(folder / "a.zarr")
    assert (totals.cells, totals.hits, totals.passes) == whole.census()[:3]
    assert str(totals.bounds) == str(whole.bounds())
    for name in ("hits", "passes", "cells"):
        ours, theirs = totals.counter.pairs(), count_pairs(whole)
        assert np.array_equal(getattr(ours, name), getattr(theirs, name))
    assert count > 0 or memory > 1
    assert count == 0 or memory < 10**9
    assert sorted(path.name for path in folder.iterdir()) == ["a.zarr", "b.zarr"]


@given(st.data())
@settings(max_examples=30)
def test_rows_add_up(data: st.DataObject) -> None:
    """Bytes that overflow, parts of votes, and tiles that have nothing."""
    d = data.draw(st.sampled_from([2, 3]))
    whole, parts = TileStore(d, 4), TileStore(d, 4)
    slot_of: dict[tuple[int, ...], int] = {}
    for seed in data.draw(st.lists(st.integers(0, 99), max_size=5)):
        rng = np.random.default_rng(seed)
        one = TileStore(d, 4)
        index = np.unique(rng.integers(-6, 6, (20, d)), axis=0)
        part = rng.choice([1, 200, ONE, 100 * ONE, 300 * ONE])
        one.add_cells(index, rng.integers(0, 3, (len(index), 2)) * part)
        whole.merge(one)
        rows = rows_of(one, np.arange(one.count))
        keys = [tuple(coords) for coords in rows.coords.tolist()]
        slots = np.array([slot_of.get(key, -1) for key in keys], np.int64)
        add_rows(parts, rows, slots)
        slot_of.update(zip(keys, slots.tolist(), strict=True))
    assert str(parts.census()) == str(whole.census())
    for ours, theirs in zip(parts.cells(), whole.cells(), strict=True):
        assert np.array_equal(ours, theirs)
    more = np.array([[0] * d])
    for tiles in (parts, whole):  # the store is one that goes on
        tiles.add_cells(more, np.array([[254 * ONE, 3]]))
    assert np.array_equal(parts.at(more), whole.at(more))


def test_too_many_votes_are_one_line(tmp_path: Path) -> None:
    def build() -> None:
        evidence = EvidenceMap(0.1)
        with BudgetedMap(evidence, tmp_path / "a.zarr", 1) as building:
            for _ in range(2):
                evidence.add_cells(np.array([[1, 1]]), np.array([MAX_UNITS]), np.array([0]))
                evidence.add_cells(np.array([[999, 1]]), np.array([1]), np.array([0]))
            building.save()

    with pytest.raises(MapTooLargeError, match=r"would pass 2\^46 votes"):
        build()
    assert list(tmp_path.iterdir()) == []


class Stop(BaseException):
    """Like Ctrl-C."""


@pytest.mark.parametrize("error", [Stop, MemoryError])
def test_nothing_is_left_after_an_error(tmp_path: Path, error: type[BaseException]) -> None:
    def build() -> None:
        evidence = EvidenceMap(0.1)
        with BudgetedMap(evidence, tmp_path / "a.zarr", 1) as building:
            add_scans(evidence, memory_kit.lidar()[:5])
            assert building.spill_count
            assert len(list(tmp_path.iterdir())) == 1
            raise error

    with pytest.raises(error):
        build()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> Any:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(tile_runs.TileRuns, "_append", full)
        with pytest.raises(OutputError, match=r"a.zarr: .*No space left on device; free some disk"):
            budgeted(memory_kit.lidar()[:5], {}, tmp_path / "a.zarr", 1)
    assert list(tmp_path.iterdir()) == []


def test_damage_is_one_line(tmp_path: Path) -> None:
    def build() -> None:
        evidence = EvidenceMap(0.1)
        with BudgetedMap(evidence, tmp_path / "a.zarr", 1) as building:
            add_scans(evidence, memory_kit.lidar()[:5])
            (file,) = tmp_path.rglob("*.votes")
            file.write_bytes(b"x" * file.stat().st_size)
            building.save()

    with pytest.raises(OutputError, match=r"a.zarr: the evidence .* cannot be read back") as found:
        build()
    assert "\n" not in str(found.value)
    assert list(tmp_path.iterdir()) == []


def test_what_comes_after_the_totals_is_saved_too(tmp_path: Path) -> None:
    scans, evidence = memory_kit.lidar()[:20], EvidenceMap(0.1)
    with BudgetedMap(evidence, tmp_path / "a.zarr", 1) as building:
        add_scans(evidence, scans[:10])
        building.total(TotalsWithPairs)
        add_scans(evidence, scans[10:])
        building.save()
    whole = oddsmap.build_map(scans, 0.1)
    again = oddsmap.load_map(tmp_path / "a.zarr")
    for ours, theirs in zip(again.cells(), whole.cells(), strict=True):
        assert np.array_equal(ours, theirs)


def test_what_a_killed_run_leaves_is_cleared(tmp_path: Path) -> None:
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("needs children that can be killed")

    def killed() -> None:
        evidence = EvidenceMap(0.1)
        with BudgetedMap(evidence, tmp_path / "a.zarr", 1):
            add_scans(evidence, memory_kit.lidar()[:5])
            os.kill(os.getpid(), signal.SIGKILL)

    oddsmap.build_map(memory_kit.lidar()[:1], 0.1)  # compiles
    child = multiprocessing.get_context("fork").Process(target=killed)
    child.start()
    child.join()
    assert child.exitcode == -signal.SIGKILL
    assert [path.suffix for path in tmp_path.iterdir()] == [".part"]
    with pytest.warns(RecoveryWarning, match=r"what a killed run left of its output, a.zarr, is"):
        oddsmap.build_saved_map(memory_kit.lidar()[:5], 0.1, tmp_path / "b.zarr")
    assert [path.name for path in tmp_path.iterdir()] == ["b.zarr"]


def test_tiles_stay_within_the_budget(tmp_path: Path) -> None:
    scans, memory = memory_kit.space(16, 90, 24), 1_000_000
    assert oddsmap.build_map(scans, 0.05).nbytes > 2 * memory
    evidence = EvidenceMap(0.05, ndim=3)
    with BudgetedMap(evidence, tmp_path / "a.zarr", memory) as building:
        most = 0
        for scan in scans:
            add_scans(evidence, scan)
            most = max(most, evidence.tiles.nbytes)
        building.total(TotalsWithPairs)
        assert most <= memory
        assert building.most_bytes <= memory
        assert building.spill_count > 1
