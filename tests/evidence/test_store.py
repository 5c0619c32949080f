# SPDX-License-Identifier: Apache-2.0
"""The map on disk: identity, atomic, readable by anyone, and clear when it is damaged."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import BeamSensor, EvidenceMap, add_scans, build_map, load_map
from oddsmap.config.config import PosteriorConfig
from oddsmap.errors import InputError, OddsmapError, OutputError
from oddsmap.evidence import store
from oddsmap.kernels.units import MAX_UNITS
from oddsmap.map_files import side_by_side
from oddsmap.map_files.zarr_folder import NewFolder
from oddsmap.map_files.zarr_shards import SavedShards
from tests.kit import ONE, Votes, add_votes, random_scans, votes_of

UTM = (10_000_000, 108_000_000)


def a_map(votes: Votes, *, side: int | None = None, ndim: int = 2) -> EvidenceMap:
    evidence = EvidenceMap(0.5, tile_side=side, ndim=ndim)
    add_votes(evidence, votes)
    return evidence


def files(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {
        str(path.relative_to(folder)): (path.read_bytes(), path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def root_of(path: Path) -> zarr.Group:
    return zarr.open_group(path, mode="r")


def array_of(path: Path, name: str, mode: Any = "r") -> zarr.Array[Any]:
    array = zarr.open_group(path, mode=mode)[name]
    assert isinstance(array, zarr.Array)
    return array


@pytest.mark.parametrize("side", [5, 32, 100, 700])
@pytest.mark.parametrize("shift", [(0, 0), (-3, -5), (1023, -1024), UTM])
def test_save_and_load_is_identity(tmp_path: Path, side: int, shift: tuple[int, int]) -> None:
    rng = np.random.default_rng(side)
    places = rng.integers(-500, 900, (200, 2)) + shift
    votes: Votes = {
        (int(x), int(y)): (int(h), int(p))
        for (x, y), (h, p) in zip(places, rng.integers(1, 1 << 40, (200, 2)), strict=True)
    }
    evidence = a_map(votes, side=side)
    evidence.save(tmp_path / "a.zarr")
    assert votes_of(load_map(tmp_path / "a.zarr")) == votes


@pytest.mark.parametrize(
    ("side", "shift"), [(2, (127, -128, 1)), (8, (*UTM, -7)), (16, (-90, 60, 128))]
)
def test_save_and_load_of_space_is_identity(
    tmp_path: Path, side: int, shift: tuple[int, int, int]
) -> None:
    rng = np.random.default_rng(side)
    places = rng.integers(-20, 20, (100, 3)) + shift
    votes: Votes = {
        (int(x), int(y), int(z)): (int(h), int(p))
        for (x, y, z), (h, p) in zip(places, rng.integers(1, 1 << 20, (100, 2)), strict=True)
    }
    a_map(votes, side=side, ndim=3).save(tmp_path / "a.zarr")
    again = load_map(tmp_path / "a.zarr")
    assert again.ndim == 3
    assert votes_of(again) == votes


def test_a_tile_across_shards_is_written_whole(tmp_path: Path) -> None:
    """Tiles of 5 cells straddle the shard's corner at (1024, 1024); so do big ones in space."""
    votes: Votes = {(x, y): (ONE, 0) for x in (1020, 1023, 1024) for y in (1020, 1023, 1024)}
    a_map(votes, side=5).save(tmp_path / "a.zarr")
    assert votes_of(load_map(tmp_path / "a.zarr")) == votes
    # A tile of 131 cells reaches into three shards of 128: 5502 and 5503, 5504..5631, 5632.
    deep: Votes = {(x, 200, z): (ONE, 2 * ONE) for x in (5503, 5504, 5632) for z in (5, 129)}
    space = EvidenceMap(0.5, ndim=3, tile_side=131)
    add_votes(space, deep)
    space.save(tmp_path / "b.zarr")
    assert votes_of(load_map(tmp_path / "b.zarr")) == deep


@pytest.mark.parametrize(
    ("most", "whole", "dtype"),
    [
        (255, True, np.uint8),
        (256, True, np.uint16),
        (65535, True, np.uint16),
        (65536, True, np.uint32),
        ((1 << 32) - 1, True, np.uint32),
        (1 << 32, True, np.uint64),
        (1, False, np.uint32),
        (1 << 16, False, np.uint64),
    ],
)
def test_the_smallest_type_that_fits(
    tmp_path: Path, most: int, whole: bool, dtype: type[np.unsignedinteger[Any]]
) -> None:
    votes: Votes = {(-7, 9): (most * ONE, 0), (2, 2): (0, ONE if whole else 3)}
    a_map(votes).save(tmp_path / "a.zarr")
    array = array_of(tmp_path / "a.zarr", "hits")
    assert array.dtype == dtype
    assert array.attrs["weight_unit"] == (1.0 if whole else 1 / ONE)
    assert votes_of(load_map(tmp_path / "a.zarr")) == votes


@given(votes=st.sampled_from(["scan", "beam"]), wide=st.sampled_from([0.0, 0.7]))
@settings(max_examples=4)
def test_a_map_of_scans(tmp_path_factory: pytest.TempPathFactory, votes: str, wide: float) -> None:
    path = tmp_path_factory.mktemp("maps") / "a.zarr"
    evidence = EvidenceMap(0.25, votes=votes, sensor=BeamSensor(hit_width=wide, share_hit=True))
    add_scans(evidence, random_scans(2, 5) * 100)  # more than 255 votes in a cell
    evidence.save(path)
    again = load_map(path)
    assert votes_of(again) == votes_of(evidence)
    assert again.config == evidence.config
    add_scans(again, random_scans(3, 5))
    add_scans(evidence, random_scans(3, 5))
    assert votes_of(again) == votes_of(evidence)


def test_an_empty_map(tmp_path: Path) -> None:
    EvidenceMap(0.1).save(tmp_path / "a.zarr")
    again = load_map(tmp_path / "a.zarr")
    assert again.cell_count() == 0
    assert again.resolution == 0.1


def test_tiles_without_evidence_do_not_count(tmp_path: Path) -> None:
    evidence = a_map({(5000, -5000): (0, 0), (1, 1): (ONE, 0)})
    evidence.save(tmp_path / "a.zarr")
    assert root_of(tmp_path / "a.zarr").attrs["known_cells_hi"] == [2, 2]
    assert votes_of(load_map(tmp_path / "a.zarr")) == {(1, 1): (ONE, 0)}


def test_the_configuration_comes_back(tmp_path: Path) -> None:
    evidence = EvidenceMap(
        0.05,
        votes="beam",
        sensor=BeamSensor(range_max=9.0, hit_width=0.2, share_hit=True, p_hit=0.8),
        posterior=PosteriorConfig(prior=0.2, free=0.1, occupied=0.9),
    )
    evidence.record("logs/hall.log", scans=3, skipped={"beam.nan": 1})
    evidence.save(tmp_path / "a.zarr")
    again = EvidenceMap.load(tmp_path / "a.zarr")
    assert again.config == evidence.config
    assert again.provenance == evidence.provenance


def test_plain_zarr_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    a_map({(-3, 2000): (2 * ONE, 0), (1500, 7): (0, 5 * ONE)}).save(path)
    root = root_of(path)
    assert sorted(root.array_keys()) == ["hits", "passes", "x", "y"]
    at: Any = root.attrs
    assert at["origin_cell"] == [-1024, 0]
    assert at["origin"] == [-512.0, 0.0]
    assert at["resolution"] == 0.5
    assert at["known_cells_lo"] == [-3, 7]
    assert at["known_cells_hi"] == [1501, 2001]
    assert (at["format"], at["format_version"]) == ("oddsmap evidence map", 1)
    assert at["votes"] == at["config"]["map"]["votes"] == "scan"
    assert at["shards"] == {"hits": [[1, 0]], "passes": [[0, 2]]}
    hits, passes = array_of(path, "hits"), array_of(path, "passes")
    assert hits.shape == passes.shape == (2048, 3072)
    assert hits.metadata.dimension_names == ("y", "x")  # type: ignore[union-attr]
    assert hits.attrs["weight_unit"] == 1.0
    # Rows are y, columns are x; counts are votes.
    assert hits[2000 - 0, -3 + 1024] == 2
    assert passes[7, 1500 + 1024] == 5
    assert np.asarray(hits[...]).sum() == 2
    # Of the six shards of each array only those with evidence are files.
    assert len(list((path / "hits" / "c").rglob("*/*"))) == 1


def test_one_shard_can_be_rewritten_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    votes: Votes = {(10, 10): (ONE, 0), (1500, 10): (ONE, 3 * ONE), (10, 1500): (0, ONE)}
    a_map(votes).save(path)
    before = files(path)
    array_of(path, "hits", "r+")[0:1024, 1024:2048] = 7
    after = files(path)
    assert [name for name in after if after[name] != before.get(name)] == ["hits/c/0/1"]
    assert "hits/c/0/1 is not what was saved" in one_line(path)
    edit(path / "zarr.json")  # on purpose
    got = votes_of(load_map(path))
    assert got[1500, 10] == (7 * ONE, 3 * ONE)
    assert got[1024, 0] == (7 * ONE, 0)
    assert got[10, 10] == (ONE, 0)
    assert len(got) == 1024 * 1024 + 2


def test_a_new_shard_can_be_written_by_another_process(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    a_map({(10, 10): (ONE, 0), (1500, 1500): (ONE, 0)}).save(path)
    array_of(path, "passes", "r+")[5, 1030] = 3
    assert votes_of(load_map(path))[1030, 5] == (0, 3 * ONE)


def test_a_box_reads_its_shards_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.zarr"
    votes: Votes = {(x, y): (ONE, x * ONE) for x in (1, 1500, 2500) for y in (2, 1023, 1024, 2500)}
    evidence = a_map(votes)
    evidence.save(path)
    read: list[tuple[int, ...]] = []
    real = SavedShards.read

    def spy(self: SavedShards, names: Any, place: tuple[int, ...], *rest: Any) -> Any:
        read.append(place)
        return real(self, names, place, *rest)

    monkeypatch.setattr(SavedShards, "read", spy)
    part = load_map(path, lo=(1000, 1000), hi=(1501, 1024))
    assert votes_of(part) == {(1500, 1023): (ONE, 1500 * ONE)}
    assert sorted(read) == [(0, 0), (0, 1)]
    assert votes_of(load_map(path, lo=(1500, 1024))) == {
        at: vote for at, vote in votes.items() if at[0] >= 1500 and at[1] >= 1024
    }
    assert votes_of(load_map(path, hi=(1501, 1024))) == {
        at: vote for at, vote in votes.items() if at[0] < 1501 and at[1] < 1024
    }
    read.clear()
    assert load_map(path, lo=(9000, 9000), hi=(9001, 9001)).cell_count() == 0
    assert read == []
    # Files outside the box may be damaged: they are not read.
    (path / "hits" / "c" / "2" / "2").write_bytes(b"rubbish")
    assert votes_of(load_map(path, hi=(2, 3))) == {(1, 2): (ONE, ONE)}


def test_a_box_reads_its_chunks_alone(tmp_path: Path) -> None:
    """Chunks outside the box may be damaged: they are not unpacked."""
    path = tmp_path / "a.zarr"
    votes: Votes = {(x, 5): (ONE, x * ONE) for x in (0, 127, 128, 300)}
    a_map(votes).save(path)
    shard = path / "hits" / "c" / "0" / "0"
    content = bytearray(shard.read_bytes())
    assert content.count(b"\x28\xb5\x2f\xfd") == 3
    content[content.rindex(b"\x28\xb5\x2f\xfd")] ^= 1  # of the last one: from x = 256 on
    shard.write_bytes(content)
    del votes[300, 5]
    assert votes_of(load_map(path, hi=(256, 99))) == votes
    with pytest.raises(InputError, match="a chunk of hits/c/0/0 does not unpack"):
        load_map(path, hi=(257, 99))


@settings(max_examples=20, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([2, 3]),
    st.booleans(),
    st.sampled_from(["both", "lo", "hi"]),
)
def test_a_box_is_what_a_crop_is(
    tmp_path_factory: pytest.TempPathFactory, seed: int, d: int, lengths: bool, open_side: str
) -> None:
    rng = np.random.default_rng(seed)
    evidence = EvidenceMap(0.5, ndim=d, votes="beam", path_lengths=lengths)
    index = np.unique(rng.integers(-200, 200, (300, d)), axis=0)
    evidence.add_cells(index, *rng.integers(0, 1 << 20, (2, len(index))))
    if evidence.lengths is not None:
        along = np.array([0, 1]) * rng.integers(0, 1 << 20, (len(index), 1))
        evidence.lengths.add_cells(index, along)
    path = tmp_path_factory.mktemp("boxes") / "a.zarr"
    evidence.save(path)
    lo, hi = np.sort(rng.integers(-250, 250, (2, d)), axis=0)
    box = {"lo": lo, "hi": hi} if open_side == "both" else {open_side: lo}
    part = load_map(path, **box)
    cut = evidence.crop(box.get("lo", [-999] * d), box.get("hi", [999] * d))
    for one, other in zip(part.cells(), cut.cells(), strict=True):
        np.testing.assert_array_equal(one, other)
    if lengths:
        for one, other in zip(part.cell_lengths(), cut.cell_lengths(), strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("lo", "hi"), [((50, 0), None), (None, (0, -3000)), ((2, 1), None)])
def test_a_box_beyond_the_map_is_empty(tmp_path: Path, lo: Any, hi: Any) -> None:
    a_map({(1, 1): (ONE, 0)}).save(tmp_path / "a.zarr")
    assert load_map(tmp_path / "a.zarr", lo=lo, hi=hi).cell_count() == 0


@pytest.mark.parametrize(("lo", "hi"), [((0, 0, 0), None), (None, (1, 2, 3)), ((5, 5), (0, 0))])
def test_odd_boxes_are_refused(tmp_path: Path, lo: Any, hi: Any) -> None:
    a_map({(1, 1): (ONE, 0)}).save(tmp_path / "a.zarr")
    with pytest.raises(InputError) as caught:
        load_map(tmp_path / "a.zarr", lo=lo, hi=hi)
    assert "damaged" not in str(caught.value)


# Writing is all or nothing.


def test_an_existing_map_is_not_replaced_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    a_map({(1, 1): (ONE, 0)}).save(path)
    before = files(path)
    with pytest.raises(OutputError, match="exists already"):
        a_map({(2, 2): (ONE, 0)}).save(path)
    assert files(path) == before
    a_map({(2, 2): (ONE, 0)}).save(path, force=True)
    assert votes_of(load_map(path)) == {(2, 2): (ONE, 0)}
    assert [p.name for p in tmp_path.iterdir()] == ["a.zarr"]


@pytest.mark.parametrize("error", [RuntimeError("boom"), KeyboardInterrupt(), OSError("disk full")])
def test_a_broken_off_write_leaves_the_old_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    path = tmp_path / "a.zarr"
    a_map({(1, 1): (ONE, 0)}).save(path)
    before = files(path)
    calls: list[int] = []
    real = NewFolder.write

    def failing(self: NewFolder, *what: Any) -> None:
        calls.append(1)
        if len(calls) == 4:  # of two arrays, in two shards
            raise error
        real(self, *what)

    monkeypatch.setattr(NewFolder, "write", failing)
    evidence = a_map({(1, 1): (ONE, 0), (2000, 1): (ONE, 0)})
    for target, force in ((path, True), (tmp_path / "new.zarr", False)):
        calls.clear()
        with pytest.raises(OutputError if isinstance(error, OSError) else type(error)):
            evidence.save(target, force=force)
        assert len(calls) >= 4  # other threads may have gone on
        assert files(path) == before
        assert [p.name for p in tmp_path.iterdir()] == ["a.zarr"]


@pytest.mark.parametrize(("ndim", "cells"), [(2, 2000), (3, 300)])
def test_the_number_of_threads_changes_no_bit(
    ndim: int, cells: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(ndim)
    index = np.unique(rng.integers(-2000, 2000, (cells, ndim)) // [1, 1, 20][:ndim], axis=0)
    evidence = EvidenceMap(0.5, ndim=ndim)
    evidence.add_cells(index, *(rng.integers(0, 300, (2, len(index))) * ONE))
    saved = []
    for threads in (1, 2, 5):
        monkeypatch.setattr(side_by_side, "_threads", lambda count=threads: count)
        path = tmp_path / f"{threads}.zarr"
        evidence.save(path)
        found = files(path)
        saved.append({name: found[name][0] for name in found if not name.endswith("zarr.json")})
        again = load_map(path)
        for one, other in zip(again.cells(), evidence.cells(), strict=True):
            np.testing.assert_array_equal(one, other)
    assert len(saved[0]) > 10
    assert saved[0] == saved[1] == saved[2]


def test_a_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="does not exist"):
        a_map({}).save(tmp_path / "no" / "a.zarr")


# Reading what is no map, or no longer one.


def one_line(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        load_map(path)
    text = str(caught.value)
    assert "\n" not in text
    assert str(path) in text
    return text


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "a.zarr"
    build_map(random_scans(1, 3), 0.25).save(path)
    return path


def edit(file: Path, **attributes: object) -> None:
    """Change attributes; the digest is set to null, as of a map that is edited on purpose."""
    root = next(at / "zarr.json" for at in file.parents if at.suffix == ".zarr")
    for each, changes in ((file, attributes), (root, {"digest": None})):
        content = json.loads(each.read_text())
        content["attributes"].update(changes)
        each.write_text(json.dumps(content))


def test_no_map_at_all(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("hello")
    (tmp_path / "folder").mkdir()
    zarr.open_group(tmp_path / "foreign.zarr", mode="w").create_array("x", shape=(3,), dtype="u1")
    foreign = zarr.open_group(tmp_path / "alike.zarr", mode="w")
    for name in ("hits", "passes"):
        foreign.create_array(name, shape=(4, 4), dtype="u1")
    for name in ("missing", "file", "folder", "foreign.zarr"):
        assert not store.is_map(tmp_path / name)
        said = "no such file" if name == "missing" else "not a saved map"
        assert said in one_line(tmp_path / name)
    assert "not one of oddsmap" in one_line(tmp_path / "alike.zarr")


def test_a_newer_format(saved: Path) -> None:
    edit(saved / "zarr.json", format_version=2)
    assert "format version 2, this oddsmap reads 1: update oddsmap" in one_line(saved)


@pytest.mark.parametrize("name", ["hits", "passes"])
def test_a_lost_shard(saved: Path, name: str) -> None:
    lost = sorted((saved / name / "c").rglob("*/*"))[0]
    lost.unlink()
    text = one_line(saved)
    assert f"{lost.relative_to(saved).as_posix()} is missing or empty" in text


@pytest.mark.parametrize("damage", ["cut", "garbled", "empty", "flipped"])
def test_a_garbled_shard(saved: Path, damage: str) -> None:
    shard = max((saved / "passes" / "c").rglob("*/*"), key=lambda file: file.stat().st_size)
    content = shard.read_bytes()
    shard.write_bytes(
        {
            "cut": content[: len(content) // 2],
            "garbled": np.random.default_rng(0).bytes(len(content)),
            "empty": b"",
            "flipped": content[:-1] + bytes([content[-1] ^ 1]),
        }[damage]
    )
    text = one_line(saved)
    assert "damaged" in text
    assert shard.relative_to(saved).as_posix() in text  # where


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"a": 1}', "\x00\x01"])
@pytest.mark.parametrize("name", ["zarr.json", "hits/zarr.json"])
def test_a_garbled_header(saved: Path, name: str, text: str) -> None:
    (saved / name).write_text(text)
    one_line(saved)


@pytest.mark.parametrize("name", ["zarr.json", "hits/zarr.json", "hits", "passes/zarr.json"])
def test_a_lost_part(saved: Path, name: str) -> None:
    part = saved / name
    if part.is_dir():
        shutil.rmtree(part)
    else:
        part.unlink()
    one_line(saved)


@pytest.mark.parametrize(
    "name",
    ["config", "origin_cell", "provenance", "shards", "format", "format_version"],
)
@pytest.mark.parametrize("value", [None, 5, "x", [], [1], [1, 2, 3, 4], {}, {"map": 3}, "gone"])
def test_attributes_of_another_kind(saved: Path, name: str, value: object) -> None:
    file = saved / "zarr.json"
    content = json.loads(file.read_text())
    content["attributes"] |= {name: value, "digest": None}
    if value == "gone":
        del content["attributes"][name]
    file.write_text(json.dumps(content))
    try:
        load_map(saved)
    except OddsmapError as error:
        message = str(error)
    else:
        assert (name, value) == ("provenance", [])
        return
    assert "\n" not in message
    assert str(saved) in message


@pytest.mark.parametrize("unit", [None, "x", -1.0, 0.0, 0.5, True, 1e300])
def test_a_weight_unit_of_another_kind(saved: Path, unit: object) -> None:
    edit(saved / "hits" / "zarr.json", weight_unit=unit)
    one_line(saved)


def test_weights_beyond_the_limit(saved: Path) -> None:
    path = saved.with_name("b.zarr")
    a_map({(0, 0): (1 << 60, 1)}).save(path)
    array_of(path, "hits", "r+")[0, 0] = (1 << 64) - 1
    edit(path / "zarr.json")
    assert "2^46 votes" in one_line(path)
    array_of(path, "hits", "r+")[0, 0] = MAX_UNITS
    edit(path / "passes" / "zarr.json", weight_unit=1.0)
    edit(path / "hits" / "zarr.json", weight_unit=1.0)
    assert "2^46 votes" in one_line(path)


def test_a_box_of_metres_is_read_alone(tmp_path: Path) -> None:
    whole = a_map({(x, y): (x * ONE, y * ONE) for x in range(1, 9) for y in range(1, 9)})
    whole.save(tmp_path / "a.zarr")
    part = load_map(tmp_path / "a.zarr", box=((1.0, 1.2), (3.0, 2.9)))
    assert votes_of(part) == votes_of(whole.crop_box((1.0, 1.2), (3.0, 2.9)))
    assert votes_of(part)
    with pytest.raises(InputError, match="lo= and hi=, or in metres, box="):
        load_map(tmp_path / "a.zarr", lo=[0, 0], box=((1.0, 1.2), (3.0, 2.9)))
    with pytest.raises(InputError, match="lowest corner before"):
        load_map(tmp_path / "a.zarr", box=((1.0, 1.2), (1.0, 2.9)))
