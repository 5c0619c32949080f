# SPDX-License-Identifier: Apache-2.0
"""Evidence added to a saved map is what merging and saving the whole makes of it."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import EvidenceMap, load_map
from oddsmap.atomic_write import one_writer, writer_lock
from oddsmap.errors import ConfigError, InputError, OutputError
from oddsmap.evidence import append, store
from oddsmap.evidence.append import append_map
from oddsmap.map_files.zarr_folder import NewFolder
from tests.kit import ONE, Votes, add_votes, votes_of

SPAWN = multiprocessing.get_context("spawn")


def a_map(
    votes: Votes, source: str = "a.log", ndim: int = 2, tile_side: int | None = None
) -> EvidenceMap:
    grid = EvidenceMap(0.5, ndim=ndim, tile_side=tile_side)
    add_votes(grid, votes)
    grid.record(source, scans=len(votes))
    return grid


def shards(path: Path) -> dict[str, Path]:
    return {
        str(file.relative_to(path)): file
        for file in path.rglob("c/**/*")
        if file.is_file() and file.relative_to(path).parts[0] not in ("x", "y", "z")
    }


def arrays(path: Path) -> dict[str, Any]:
    """What Zarr knows of the arrays, and the bytes of all shards."""
    found: dict[str, Any] = {name: file.read_bytes() for name, file in shards(path).items()}
    for name in ("hits", "passes", "lengths", "x", "y"):
        if (path / name).exists():
            known = json.loads((path / name / "zarr.json").read_bytes())
            known["attributes"].pop("save", None)
            found[name] = known
    return found


def group(path: Path) -> dict[str, Any]:
    attributes: dict[str, Any] = json.loads((path / "zarr.json").read_bytes())["attributes"]
    return {name: value for name, value in attributes.items() if name not in ("save", "digest")}


def names_in(folder: Path) -> list[str]:
    return sorted(each.name for each in folder.iterdir())


WEIGHTS = st.sampled_from([0, ONE, 7 * ONE, 200 * ONE, 70_000 * ONE])
PARTS = st.sampled_from([0, 1, ONE // 2, ONE, 300 * ONE])
PLACES = st.sampled_from([-3000, -1, 0, 5, 1023, 1024, 2500])


def cells(d: int, weights: st.SearchStrategy[int]) -> st.SearchStrategy[Votes]:
    return st.dictionaries(
        st.tuples(*[PLACES] * d), st.tuples(weights, weights).filter(any), max_size=4
    )


@settings(max_examples=15, deadline=None)
@given(st.data(), st.sampled_from([2, 3]), st.sampled_from([None, 5, 1024]))
def test_it_is_the_map_of_both(data: st.DataObject, d: int, side: int | None) -> None:
    side = None if d == 3 else side
    first, second, third = (
        data.draw(cells(d, kind)) for kind in (WEIGHTS, WEIGHTS, WEIGHTS | PARTS)
    )
    a = a_map(first, ndim=d)
    b = a_map(second, "b.log", d, tile_side=side)
    c = a_map(third, "c.log", d)
    with tempfile.TemporaryDirectory() as folder:
        path, whole = Path(folder, "map.zarr"), Path(folder, "whole.zarr")
        a.save(path)
        for more in (b, c):
            before = load_map(path).cell_count()
            did = append_map(more, path)
            assert did.cells_new == load_map(path).cell_count() - before
            assert not did.copied
        both = a + b + c
        both.save(whole)
        again = load_map(path)
        assert votes_of(again) == votes_of(both)
        assert (again.provenance, again.config) == (both.provenance, both.config)
        assert names_in(Path(folder)) == ["map.zarr", "whole.zarr"]
        if both.census().cells:
            assert group(path)["known_cells_lo"] == group(whole)["known_cells_lo"]
            assert group(path) == group(whole)
        if both.census().whole_votes and (a + b).census().whole_votes == c.census().whole_votes:
            assert arrays(path) == arrays(whole), "to the byte"


def test_lengths_are_added_too(tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    maps = []
    for cell in (0, 5000):
        grid = EvidenceMap(0.5, votes="beam", path_lengths=True)
        add_votes(grid, {(cell, 0): (ONE, ONE)})
        assert grid.lengths is not None
        grid.lengths.add_cells(np.array([[cell, 0], [9000, cell]]), np.array([[0, 7], [0, 70_000]]))
        maps.append(grid)
    maps[0].save(path)
    maps[1].save(path, append=True)
    both = maps[0] + maps[1]
    for here, there in zip(load_map(path).cell_lengths(), both.cell_lengths(), strict=True):
        np.testing.assert_array_equal(here, there)
    both.save(tmp_path / "whole.zarr")
    assert arrays(path) == arrays(tmp_path / "whole.zarr")


FAR: Votes = {(1, 1): (ONE, 0), (5000, 1): (ONE, ONE), (5000, 5000): (0, ONE)}


def test_other_shards_are_the_same_files(tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    a_map(FAR).save(path)
    before = {name: file.stat().st_ino for name, file in shards(path).items()}
    did = append_map(a_map({(2, 2): (0, 3 * ONE)}), path)
    assert (did.shards_written, did.shards_kept, did.rewritten) == (1, 2, None)
    after = {name: file.stat() for name, file in shards(path).items()}
    same = {name for name in before if after[name].st_ino == before[name]}
    assert same == set(before) - {"hits/c/0/0", "passes/c/0/0"}
    assert {stat.st_nlink for stat in after.values()} == {1}, "the old map has gone"


def test_a_copy_of_links_stays_as_it_was(tmp_path: Path) -> None:
    """No file is ever changed in place, so `cp -al` keeps a map as of today."""
    path, kept = tmp_path / "map.zarr", tmp_path / "monday.zarr"
    a_map(FAR).save(path)
    shutil.copytree(path, kept, copy_function=os.link)
    a_map({(2, 2): (0, ONE), (5000, 1): (300 * ONE, 0)}).save(path, append=True)
    assert votes_of(load_map(kept)) == FAR
    assert votes_of(load_map(path)) != FAR


def test_a_map_that_grows_to_every_side(tmp_path: Path) -> None:
    """Its shards have other names then, and are the same files."""
    path = tmp_path / "map.zarr"
    a_map(FAR).save(path)
    before = {file.stat().st_ino for file in shards(path).values()}
    did = append_map(a_map({(-70_000, -1): (ONE, 0)}), path)
    assert (did.shards_written, did.shards_kept) == (1, 3)
    assert {file.stat().st_ino for file in shards(path).values()} > before
    assert votes_of(load_map(path)) == FAR | {(-70_000, -1): (ONE, 0)}


@pytest.mark.parametrize(
    ("weight", "why", "dtype"),
    [
        (ONE, None, "uint8"),
        (255 * ONE, "a count passed what uint8 holds", "uint16"),
        (ONE // 2, "parts of votes were added to whole votes", "uint32"),
    ],
)
def test_what_makes_all_shards_new(
    weight: int, why: str | None, dtype: str, tmp_path: Path
) -> None:
    path = tmp_path / "map.zarr"
    a_map(FAR).save(path)
    did = append_map(a_map({(1, 1): (weight, 0)}), path)
    assert did.rewritten == why
    assert json.loads((path / "hits" / "zarr.json").read_bytes())["data_type"] == dtype
    assert votes_of(load_map(path)) == FAR | {(1, 1): (ONE + weight, 0)}


def test_without_hard_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refused)
    path = tmp_path / "map.zarr"
    a_map(FAR).save(path)
    assert append_map(a_map({(2, 2): (0, ONE)}), path).copied
    assert votes_of(load_map(path)) == FAR | {(2, 2): (0, ONE)}


def test_what_others_have_noted_stays(tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    a_map(FAR).save(path)
    root = json.loads((path / "zarr.json").read_bytes())
    root["attributes"]["site"] = "hall 3"
    (path / "zarr.json").write_text(json.dumps(root))
    a_map({(2, 2): (0, ONE)}).save(path, append=True)
    assert group(path)["site"] == "hall 3"
    (tmp_path / "link.zarr").symlink_to("map.zarr")
    a_map({(2, 2): (0, ONE)}).save(tmp_path / "link.zarr", append=True)
    assert (tmp_path / "link.zarr").is_symlink()
    assert votes_of(load_map(path))[2, 2] == (0, 2 * ONE)


def test_what_does_not_add_up(tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    a_map(FAR).save(path)
    files = {name: file.read_bytes() for name, file in shards(path).items()}
    for other, words in (
        (EvidenceMap(0.25), "different resolution cannot be added: 0.5 here, 0.25 there"),
        (EvidenceMap(0.5, ndim=3), "different ndim"),
        (EvidenceMap(0.5, votes="beam"), "different votes"),
    ):
        with pytest.raises(InputError, match=words) as error:
            other.save(path, append=True)
        assert str(error.value).startswith(f"{path}: ")
    heaviest: Votes = {(1, 1): (2**62, 0)}
    with pytest.raises(MemoryError, match="pass 2\\^46 votes"):
        a_map(heaviest).save(path, append=True)
    with pytest.raises(ConfigError, match="leave one out"):
        a_map({}).save(path, append=True, force=True)
    for gone in (tmp_path / "gone.zarr", tmp_path / "no" / "gone.zarr"):
        with pytest.raises(InputError, match="no such file"):
            a_map({}).save(gone, append=True)
    assert {name: file.read_bytes() for name, file in shards(path).items()} == files
    assert names_in(tmp_path) == ["map.zarr"]


@pytest.mark.parametrize("name", ["hits/c/0/0", "passes/c/4/4"])
def test_damage(name: str, tmp_path: Path) -> None:
    """Of a shard that is reached, and of one that is to be written anew."""
    path = tmp_path / "map.zarr"
    a_map(FAR).save(path)
    content = bytearray((path / name).read_bytes())
    content[10] ^= 4
    (path / name).write_bytes(content)
    with pytest.raises(InputError, match=r"map\.zarr: damaged, cannot be read as a map: a chunk"):
        append_map(a_map({(1, 1): (300 * ONE, 0)}), path)
    (path / name).unlink()
    with pytest.raises(InputError, match="is missing or empty"):
        append_map(a_map({(1, 1): (ONE, 0)}), path)
    assert names_in(tmp_path) == ["map.zarr"]


def test_a_full_disk_leaves_the_old_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    path = tmp_path / "map.zarr"
    a_map(FAR).save(path)
    monkeypatch.setattr(NewFolder, "write", full)
    with pytest.raises(OutputError, match="No space left on device"):
        append_map(a_map({(1, 1): (ONE, 0)}), path)
    assert votes_of(load_map(path)) == FAR
    assert names_in(tmp_path) == ["map.zarr"]


def test_a_map_that_is_replaced_meanwhile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a writer that asks for no lock: what it wrote is what is added to."""
    path = tmp_path / "map.zarr"
    a_map(FAR).save(path)
    real, times = store.attributes_of, []

    def replaced_before(*args: Any) -> Any:
        times.append(1)
        if len(times) == 1:
            a_map({(7, 7): (ONE, 0)}).save(path, force=True)
        return real(*args)

    monkeypatch.setattr(append, "attributes_of", replaced_before)
    append_map(a_map({(1, 1): (ONE, 0)}), path)
    assert votes_of(load_map(path)) == {(7, 7): (ONE, 0), (1, 1): (ONE, 0)}
    assert len(times) == 2

    def replaced_each_time(*args: Any) -> Any:
        a_map(FAR).save(path, force=True)
        return real(*args)

    monkeypatch.setattr(append, "attributes_of", replaced_each_time)
    monkeypatch.setattr(append, "_TRIES", 3)
    with pytest.raises(OutputError, match="was replaced each of the 3 times"):
        append_map(a_map({(1, 1): (ONE, 0)}), path)
    assert votes_of(load_map(path)) == FAR


# Several writers, and readers beside them.


def add_often(path: Path, number: int, times: int) -> None:
    for i in range(times):
        grid = a_map({(1, 1): (ONE, 0), (1000 * number, 1500 * i): (0, ONE)}, f"{number}.log")
        grid.save(path, append=True)


def test_nothing_is_lost_of_several_writers(tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    a_map({(1, 1): (ONE, 0)}).save(path)
    writers = [SPAWN.Process(target=add_often, args=(path, number, 4)) for number in (1, 2)]
    threads = [threading.Thread(target=add_often, args=(path, number, 4)) for number in (3, 4)]
    everyone: list[Any] = [*writers, *threads]
    for each in everyone:
        each.start()
    counts = []
    while any(each.is_alive() for each in everyone):
        votes = votes_of(load_map(path))
        counts.append(votes[1, 1][0] // ONE)
        assert len(votes) == counts[-1], "a map as it was at one time"
    for each in everyone:
        each.join()
    assert [each.exitcode for each in writers] == [0, 0]
    grid = load_map(path)
    assert votes_of(grid)[1, 1] == (17 * ONE, 0)
    assert grid.cell_count() == 17
    assert sorted(entry["source"] for entry in grid.provenance[1:]) == sorted(
        f"{number}.log" for number in (1, 2, 3, 4) for _ in range(4)
    )
    assert counts == sorted(counts)
    assert names_in(tmp_path) == ["map.zarr"]


def test_who_waits_says_so(tmp_path: Path) -> None:
    path, said = tmp_path / "map.zarr", []
    a_map(FAR).save(path)

    def waiting() -> None:
        said.append(1)
        held.set()

    held = threading.Event()
    with one_writer(path):
        adding = threading.Thread(
            target=append_map, args=(a_map({(2, 2): (ONE, 0)}), path), kwargs={"waiting": waiting}
        )
        adding.start()
        assert held.wait(20)
        assert votes_of(load_map(path)) == FAR
    adding.join()
    assert said == [1]
    assert votes_of(load_map(path))[2, 2] == (ONE, 0)


def test_where_there_are_no_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_lock, "try_lock", lambda _: None)
    path = tmp_path / "map.zarr"
    a_map(FAR).save(path)
    append_map(a_map({(2, 2): (ONE, 0)}), path)
    assert names_in(tmp_path) == ["map.zarr"]
