# SPDX-License-Identifier: Apache-2.0
"""A map with its history: every state is the sum of what was added until then, exactly."""

from __future__ import annotations

import datetime
import multiprocessing
import os
import pickle
import shutil
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import EvidenceMap, MapHistory
from oddsmap.errors import InputError, OutputError
from oddsmap.evidence.history_log import place_in
from oddsmap.kernels.vote.tiles import WIDE_COUNT
from oddsmap.map_files.icechunk_repository import CommitRecord
from tests.kit import ONE, Votes, add_votes, votes_of

SPAWN = multiprocessing.get_context("spawn")


def a_map(votes: Votes, source: str = "a.log", ndim: int = 2) -> EvidenceMap:
    grid = EvidenceMap(0.5, ndim=ndim)
    add_votes(grid, votes)
    grid.record(source, scans=len(votes))
    return grid


WEIGHTS = st.sampled_from([0, 1, ONE // 2, ONE, 200 * ONE, 70_000 * ONE])
PLACES = st.sampled_from([-3000, -1, 0, 5, 1023, 1024, 1 << 20])


@st.composite
def maps(draw: st.DrawFn) -> list[EvidenceMap]:
    d = draw(st.sampled_from([2, 3]))
    cells = st.dictionaries(
        st.tuples(*[PLACES] * d), st.tuples(WEIGHTS, WEIGHTS).filter(any), min_size=1, max_size=4
    )
    votes = draw(st.lists(cells, min_size=1, max_size=4))
    return [a_map(each, f"{number}.log", d) for number, each in enumerate(votes)]


def test_commits_are_found_by_id_and_time() -> None:
    def at(text: str) -> datetime.datetime:
        return datetime.datetime.fromisoformat(text)

    records = [
        CommitRecord("AB2", at("2026-11-25T00:00+00:00"), "", {}),
        CommitRecord("AA1", at("2026-11-24T23:59:59.999999+00:00"), "", {}),
        CommitRecord("20261124", at("2026-11-23T12:00+00:00"), "", {}),
    ]
    for given_as, place in (
        (None, 0), ("AB2", 0), ("aa", 1), ("20261124", 2), ("2026-11-24", 1), ("2026-11-25", 0),
        ("2026-11-25T00:59+01:00", 2), ("2026-11-25T01:00+01:00", 0), ("2026-11-23 12:00", 2),
        (datetime.date(2026, 11, 24), 1), (at("2026-11-24T00:00"), 2),
    ):  # fmt: skip
        assert place_in(records, given_as, "m") == place, given_as
    for wrong, said in (
        ("A", "several ids"), ("", "several ids"), ("x", "no id"), ("2026-13-01", "no id"),
        ("2026-11-22", "its first commit is of 2026-11-23T12:00:00Z"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=said):
            place_in(records, wrong, "m")
    with pytest.raises(InputError, match="no map in it yet"):
        place_in([], None, "m")


def test_without_icechunk_it_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "icechunk", None)
    with pytest.raises(InputError, match=r'm: .*pip install "oddsmap\[icechunk\]"$'):
        EvidenceMap.history("m").load()


class TestRepository:
    @pytest.fixture(autouse=True)
    def _icechunk(self) -> None:
        pytest.importorskip("icechunk", reason='needs pip install "oddsmap[icechunk]"')

    @settings(max_examples=15, deadline=None)
    @given(maps(), st.data())
    def test_each_state_is_the_sum_until_then(
        self, parts: list[EvidenceMap], data: st.DataObject
    ) -> None:
        with tempfile.TemporaryDirectory() as folder:
            history = EvidenceMap.history(Path(folder, "m.icechunk"))
            states: list[tuple[str, EvidenceMap]] = []
            total = parts[0].like()
            for part in parts:
                total = total + part
                states.append((history.add(part).id, total))
            out = data.draw(st.sampled_from(parts))
            total = total - out
            states.append((history.subtract(out, "a bad drive").id, total))
            log = history.log()
            assert [each.id for each in log] == [made for made, _ in reversed(states)]
            assert [each.done for each in log] == ["subtracted", *["added"] * len(parts)]
            assert log[0].message == "a bad drive"
            assert log[-1].message == "added 0.log"
            for made, whole in states:
                state = history.load(at=made)
                assert votes_of(state) == votes_of(whole)
                assert (state.provenance, state.config) == (whole.provenance, whole.config)
                if state.cell_count():
                    assert np.array_equal(state.bounds(), whole.bounds())  # type: ignore[arg-type]  # neither is empty
            assert votes_of(history.load()) == votes_of(total)
            assert history.like().config == total.config

    def test_lengths_are_kept(self, tmp_path: Path) -> None:
        history = EvidenceMap.history(tmp_path / "m.icechunk")
        maps = []
        for cell in (0, 5000):
            grid = EvidenceMap(0.5, votes="beam", path_lengths=True)
            add_votes(grid, {(cell, 0): (ONE, ONE)})
            assert grid.lengths is not None
            grid.lengths.add_cells(
                np.array([[cell, 0], [9000, 0]]), np.array([[0, 7], [0, 70_000]])
            )
            maps.append(grid)
            history.add(grid)
        for ours, theirs in zip(
            history.load().cell_lengths(), (maps[0] + maps[1]).cell_lengths(), strict=True
        ):
            assert np.array_equal(ours, theirs)
        history.subtract(maps[1])
        assert votes_of(history.load()) == votes_of(maps[0])

    def test_other_storages_serve_too(self) -> None:
        import icechunk

        history = EvidenceMap.history(icechunk.in_memory_storage())
        history.add(a_map({(1, 2, 9): (ONE, 0)}, ndim=3))
        grid = history.load()
        assert votes_of(grid) == {(1, 2, 9): (ONE, 0)}
        assert grid.tiles.arrays.counts[WIDE_COUNT] == 0, "whole votes, in small tiles again"

    def test_any_zarr_reader_opens_it(self, tmp_path: Path) -> None:
        import icechunk
        import zarr

        path = tmp_path / "m.icechunk"
        EvidenceMap.history(path).add(a_map({(-2, 1): (3 * ONE, ONE)}))
        repository = icechunk.Repository.open(icechunk.local_filesystem_storage(str(path)))
        group = zarr.open_group(repository.readonly_session("main").store, mode="r")
        x, y = (np.array([-2, 1]) - group.attrs["origin_cell"]).tolist()
        hits: Any = group["hits"]
        assert hits[y, x] * hits.attrs["weight_unit"] == 3

    def test_what_is_refused_changes_nothing(self, tmp_path: Path) -> None:
        path = tmp_path / "m.icechunk"
        history = EvidenceMap.history(path)
        history.add(a_map({(0, 0): (ONE, 0)}))
        (tmp_path / "file").write_text("mine")

        def elsewhere(name: str) -> MapHistory[EvidenceMap]:
            return EvidenceMap.history(tmp_path / name)

        one = a_map({(0, 1): (ONE, 0)})
        for refused, kind, said in (
            (lambda: history.add(a_map({(1 << 30, 0): (ONE, 0)})), InputError, "1073741824 cells"),
            (lambda: history.add(a_map({(0,) * 3: (ONE, 0)}, ndim=3)), InputError, "ndim"),
            (lambda: history.add(EvidenceMap(0.5)), InputError, "no evidence"),
            (lambda: history.subtract(one), InputError, "does not hold"),
            (lambda: elsewhere("no").load(), InputError, "no such folder"),
            (lambda: elsewhere("no").subtract(one), InputError, "no such folder"),
            (lambda: elsewhere("file").load(), InputError, "not an Icechunk repository"),
            (lambda: elsewhere("file").add(one), OutputError, "no Icechunk repository"),
            (lambda: elsewhere("no/no").add(one), OutputError, "cannot be written: No such file"),
        ):
            with pytest.raises(kind, match=said) as error:
                refused()
            assert str(error.value).startswith(str(tmp_path))
            assert "\n" not in str(error.value)
        assert len(history.log()) == 1
        assert sorted(each.name for each in tmp_path.iterdir()) == ["file", "m.icechunk"]

    def test_a_repository_of_another_program(self, tmp_path: Path) -> None:
        import icechunk
        import zarr

        path = tmp_path / "m.icechunk"
        repository = icechunk.Repository.create(icechunk.local_filesystem_storage(str(path)))
        history = EvidenceMap.history(path)
        with pytest.raises(InputError, match="no map in it yet"):
            history.load()
        session = repository.writable_session("main")
        zarr.create_group(session.store)
        session.commit("theirs")
        assert [each.done for each in history.log()] == [""]
        for use in (history.load, lambda: history.add(a_map({(0, 0): (ONE, 0)}))):
            with pytest.raises(InputError, match="not one of oddsmap"):
                use()

    def test_killed_as_the_repository_was_made(self, tmp_path: Path) -> None:
        path = tmp_path / "m.icechunk"
        history = EvidenceMap.history(path)
        history._repository.make()
        shutil.rmtree(path / "refs")
        (path / "snapshots" / "mine").write_text("")
        with pytest.raises(OutputError, match="no Icechunk repository"):
            history.add(a_map({(0, 0): (ONE, 0)}))
        (path / "snapshots" / "mine").unlink()
        with pytest.raises(InputError, match="not an Icechunk repository"):
            history.load()
        history.add(a_map({(0, 0): (ONE, 0)}))
        assert votes_of(history.load()) == {(0, 0): (ONE, 0)}

    @pytest.mark.skipif(os.name == "nt", reason="needs the right to make links")
    def test_one_folder_has_one_lock(self, tmp_path: Path) -> None:
        path = tmp_path / "m.icechunk"
        EvidenceMap.history(path).add(a_map({(0, 0): (ONE, 0)}))
        (tmp_path / "other").mkdir()
        link = tmp_path / "other" / "link.icechunk"
        link.symlink_to(path)
        waited: list[int] = []
        done = threading.Event()

        def add() -> None:
            linked = EvidenceMap.history(link)
            linked.add(a_map({(0, 0): (ONE, 0)}), waiting=lambda: waited.append(1))
            done.set()

        with EvidenceMap.history(path)._repository.one_at_a_time(lambda: None):
            thread = threading.Thread(target=add)
            thread.start()
            while not waited:
                time.sleep(0.002)
            assert not done.is_set()
        thread.join()
        assert votes_of(EvidenceMap.history(path).load()) == {(0, 0): (2 * ONE, 0)}

    def test_a_damaged_shard_is_named(self, tmp_path: Path) -> None:
        history = EvidenceMap.history(tmp_path / "m.icechunk")
        history.add(a_map({(x, 0): (ONE, ONE) for x in range(-600, 600)}))
        chunks = [
            each for each in (tmp_path / "m.icechunk" / "chunks").rglob("*") if each.is_file()
        ]
        assert chunks
        for file in chunks:
            content = bytearray(file.read_bytes())
            content[len(content) // 2] ^= 0xFF
            file.write_bytes(content)
        with pytest.raises(InputError, match="cannot be read") as error:
            history.load()
        assert "\n" not in str(error.value)

    def test_what_holds_it_can_be_pickled(self, tmp_path: Path) -> None:
        history = EvidenceMap.history(tmp_path / "m.icechunk")
        history.add(a_map({(0, 0): (ONE, 0)}))
        again = pickle.loads(pickle.dumps(history))
        assert votes_of(again.load()) == {(0, 0): (ONE, 0)}
        assert repr(again) == repr(history)

    @pytest.mark.parametrize(("there", "times"), [(0, 2), (5000, 1)])
    def test_of_two_commits_at_once_none_is_lost(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: int, times: int
    ) -> None:
        path = tmp_path / "m.icechunk"
        history = EvidenceMap.history(path)
        history.add(a_map({(0, 0): (ONE, 0)}))
        change, calls = MapHistory._change, 0

        def changed(*args: Any, **named: Any) -> None:
            nonlocal calls
            change(*args, **named)
            calls += 1
            if calls == 1:
                with monkeypatch.context() as inside:
                    inside.setattr(MapHistory, "_change", change)
                    EvidenceMap.history(path).add(a_map({(there, 1): (ONE, ONE)}, "quick.log"))

        monkeypatch.setattr(MapHistory, "_change", changed)
        history.add(a_map({(0, 0): (0, 7 * ONE)}, "slow.log"))
        assert calls == times, "made again where the two reach one shard"
        assert votes_of(history.load()) == {(0, 0): (ONE, 7 * ONE), (there, 1): (ONE, ONE)}
        assert [each.sources for each in history.log()] == [["slow.log"], ["quick.log"], ["a.log"]]

    def test_processes_add_to_one_shard(self, tmp_path: Path) -> None:
        path = tmp_path / "m.icechunk"
        workers = [SPAWN.Process(target=_add, args=(path, 4)) for _ in range(2)]
        for each in workers:
            each.start()
        for each in workers:
            each.join()
        assert [each.exitcode for each in workers] == [0, 0]
        history = EvidenceMap.history(path)
        assert votes_of(history.load()) == dict.fromkeys(CELLS, (8 * ONE, 0))
        assert len(history.log()) == 8
        assert [each.name for each in tmp_path.iterdir()] == ["m.icechunk"], "no lock is left"

    @pytest.mark.skipif(os.name == "nt", reason="needs SIGKILL")
    def test_killed_while_adding(self, tmp_path: Path) -> None:
        path = tmp_path / "m.icechunk"
        history = EvidenceMap.history(path)
        history.add(a_map(dict.fromkeys(CELLS, (ONE, 0))))
        for after in (0.0, 0.004, 0.011):
            before = len(history.log())
            worker = SPAWN.Process(target=_add, args=(path, 1000))
            worker.start()
            while len(history.log()) < before + 2:
                time.sleep(0.002)
            time.sleep(after)
            assert worker.pid is not None
            os.kill(worker.pid, signal.SIGKILL)
            worker.join()
            commits = len(history.log())
            whole = dict.fromkeys(CELLS, (commits * ONE, 0))
            assert votes_of(history.load()) == whole
        history.add(a_map(dict.fromkeys(CELLS, (ONE, 0))))
        assert len(history.log()) == commits + 1


CELLS = [(0, 0), (2000, 0)]  # in two shards


def _add(path: Path, times: int) -> None:
    for _ in range(times):
        EvidenceMap.history(path).add(a_map(dict.fromkeys(CELLS, (ONE, 0))))
