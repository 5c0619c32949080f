# SPDX-License-Identifier: Apache-2.0
"""Maps that come from maps: nothing that changes is shared, and boxes end where they say."""

from __future__ import annotations

import copy
import dataclasses
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import BeamSensor, EvidenceMap, InputError, Scan, add_scans, load_map
from oddsmap.config.config import PosteriorConfig
from tests.kit import ONE, random_scans, votes_of
from tests.kit3d import random_space_scans

# ---- maps of their own ------------------------------------------------------------------------


def lengthy(ndim: int = 2, **settings: Any) -> EvidenceMap:
    """A map with evidence of everything, lengths and a half-life among it."""
    evidence = EvidenceMap(
        0.25, votes="beam", ndim=ndim, path_lengths=True, half_life=9.0, t_ref_ns=0, **settings
    )
    scans = random_scans(5, 2) if ndim == 2 else random_space_scans(5, 2)
    add_scans(evidence, [dataclasses.replace(scan, stamp_ns=0) for scan in scans])
    evidence.record("hall.log", scans=2)
    return evidence


def content(evidence: EvidenceMap) -> tuple[Any, ...]:
    """All that there is in a map, as plain values of its own."""
    return (
        evidence.config.to_dict(),
        json.dumps(evidence.provenance),
        [array.tolist() for array in evidence.cells()],
        [array.tolist() for array in evidence.cell_lengths()],
    )


def merged(evidence: EvidenceMap) -> EvidenceMap:
    other = evidence.like()
    other.merge(evidence)
    return other


RELATIVES: dict[str, Callable[[EvidenceMap], EvidenceMap]] = {
    "like": lambda evidence: evidence.like(),
    "crop": lambda evidence: evidence.crop([-99] * evidence.ndim, [99] * evidence.ndim),
    "rescaled": lambda evidence: evidence.rescaled(0),
    "merge": merged,
    "deepcopy": copy.deepcopy,
}


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("name", RELATIVES)
def test_maps_share_nothing_that_changes(name: str, ndim: int) -> None:
    """Whatever is done to one of two maps, the other stays as it is."""
    for changed_one in (0, 1):
        evidence = lengthy(ndim)
        pair = (evidence, RELATIVES[name](evidence))
        assert name == "like" or pair[1].cell_count() == evidence.cell_count()
        other = pair[1 - changed_one]
        before = content(other)
        one = pair[changed_one]
        for tiles in (one.tiles, one.lengths):
            assert tiles is not None
            for array in tiles.arrays:
                array[...] = 0
        one.provenance.append({"source": "another.log"})
        one.record("third.log")
        one.config = EvidenceMap(1.0).config
        assert content(other) == before


def test_a_map_hands_out_copies() -> None:
    evidence = lengthy()
    before = content(evidence)
    box = evidence.bounds()
    assert box is not None
    view = evidence.log_odds()
    handed = (
        *box,
        *evidence.cells(),
        *evidence.cell_lengths(),
        *evidence.region(*box),
        *evidence.region_units(*box),
        evidence.region_lengths(*box),
        view.log_odds(),
        view.probability(),
        *view.cells(),
    )
    for array in handed:
        array[...] = 1
    assert content(evidence) == before


def test_what_is_added_stays_the_callers() -> None:
    evidence = EvidenceMap(0.25)
    index, hits, passes = np.array([[1, 2], [3, 4]]), np.array([5, 6]), np.array([7, 8])
    evidence.add_cells(index, hits, passes)
    before = votes_of(evidence)
    assert (index.tolist(), hits.tolist(), passes.tolist()) == ([[1, 2], [3, 4]], [5, 6], [7, 8])
    index[...], hits[...], passes[...] = 0, 0, 0
    assert votes_of(evidence) == before


# ---- boxes ------------------------------------------------------------------------------------


@pytest.mark.parametrize("ndim", [2, 3])
def test_a_crop_ends_before_hi_on_each_side(ndim: int) -> None:
    """Every box of a full block of cells, by slices of the whole; lengths are cut alike."""
    size = 5
    shape = (size,) * ndim
    places = np.stack(np.unravel_index(np.arange(size**ndim), shape)[::-1], axis=1) - 2
    evidence = EvidenceMap(1.0, votes="beam", ndim=ndim, path_lengths=True, tile_side=4)
    number = np.arange(1, size**ndim + 1)
    evidence.add_cells(places, number, 1000 * number)
    assert evidence.lengths is not None
    evidence.lengths.add_cells(places, np.stack([0 * number, 7 * number], axis=1))
    whole = number.reshape(shape)  # z and y before x
    spans = [(a, b) for a in range(size + 1) for b in range(a, size + 1)]
    # Boxes that differ from the whole along one axis at a time.
    for axis in range(ndim):
        for a, b in spans:
            lo, hi = np.full(ndim, -2), np.full(ndim, size - 2)
            lo[axis], hi[axis] = a - 2, b - 2
            want = np.take(whole, range(a, b), axis=ndim - 1 - axis)
            part = evidence.crop(lo, hi)
            hits, passes = part.region_units([-2] * ndim, [size - 2] * ndim)
            assert sorted(part.cells()[1].tolist()) == sorted(want.ravel().tolist())
            assert hits.sum() == want.sum()
            assert (passes == 1000 * hits).all()
            assert sorted(part.cell_lengths()[1].tolist()) == sorted((7 * want).ravel().tolist())
            assert (evidence.region_units(lo, hi)[0] == want).all()
            assert (evidence.region_lengths(lo, hi) * ONE == 7 * want).all()
            assert (part.region_units(lo, hi)[0] == want).all()


# ---- what a map says of itself ----------------------------------------------------------------


@pytest.mark.parametrize("ndim", [2, 3])
def test_the_bytes_of_a_map_are_those_of_votes_and_lengths(ndim: int) -> None:
    evidence = lengthy(ndim)
    assert evidence.lengths is not None
    assert min(evidence.tiles.nbytes, evidence.lengths.nbytes) > EvidenceMap(1.0, ndim=ndim).nbytes
    assert evidence.nbytes == evidence.tiles.nbytes + evidence.lengths.nbytes


@pytest.mark.parametrize("threads", [1, 2])
def test_the_time_of_reading_is_that_of_the_log(
    threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a clock that goes on while a log is read, and stands still else."""
    now = 0.0

    def log() -> Iterator[Scan]:
        nonlocal now
        for scan in random_scans(5, 3):
            now += 5.0
            yield scan
        now += 2.0

    scans, clock = log(), lambda: now
    monkeypatch.setattr(time, "perf_counter", clock)
    report = add_scans(EvidenceMap(0.25), scans, threads=threads)
    assert (report.read_s, report.integrate_s, report.compile_s) == (17.0, 0.0, 0.0)


def test_a_map_of_many_tiles_is_gone_through_to_the_last(tmp_path: Path) -> None:
    """Tiles are handled 4096 at a time; each of these cells has a tile of its own."""
    count = 2 * 4096 + 1
    index = np.stack([np.arange(count) % 97, np.arange(count) // 97], axis=1)
    evidence = EvidenceMap(0.25, tile_side=1)
    evidence.add_cells(index, np.arange(1, count + 1), np.zeros(count, np.int64))
    want = votes_of(evidence)
    assert len(want) == evidence.cell_count() == count
    other = evidence.like()
    other.merge(evidence)
    evidence.save(tmp_path / "many.zarr")
    for twin in (other, evidence.crop((0, 0), (97, 97)), EvidenceMap.load(tmp_path / "many.zarr")):
        assert votes_of(twin) == want
    evidence.merge(evidence)
    assert votes_of(evidence) == {cell: (2 * hit, 0) for cell, (hit, _) in want.items()}


# ---- maps on disk -----------------------------------------------------------------------------


@pytest.mark.parametrize("ndim", [2, 3])
def test_a_stored_map_is_what_it_was(ndim: int, tmp_path: Path) -> None:
    """All settings another than the default, and two logs: what is left out comes back changed."""
    evidence = EvidenceMap(
        0.3,
        ndim=ndim,
        votes="beam",
        path_lengths=True,
        half_life=7.0,
        t_ref_ns=5,
        sensor=BeamSensor(p_hit=0.8, range_max=9.0),
        posterior=PosteriorConfig(prior=0.3, free=0.1, occupied=0.9),
    )
    places = np.array([[-2000, 3, 70], [5, -7, 100], [40, 1500, -300]])[:, :ndim]
    evidence.add_cells(places, np.array([1, 2, 3]), np.array([40, 50, 60]))
    evidence.record("one.log", scans=1)
    evidence.record("other.log", scans=2)
    evidence.save(tmp_path / "a.zarr")
    again = EvidenceMap.load(tmp_path / "a.zarr")
    assert content(again) == content(evidence)
    attributes = json.loads((tmp_path / "a.zarr" / "zarr.json").read_text())["attributes"]
    lo, hi = evidence.bounds() or (None, None)
    assert lo is not None
    assert hi is not None
    assert attributes["known_cells_lo"] == lo.tolist()
    assert attributes["known_cells_hi"] == hi.tolist()
    first = attributes["origin_cell"]
    assert all(a <= b for a, b in zip(first, lo, strict=True))
    assert len(set(first)) == ndim, "axes that are swapped would not show"
    assert attributes["origin"] == [cell * 0.3 for cell in first]
    assert (attributes["resolution"], attributes["votes"]) == (0.3, "beam")


@pytest.mark.parametrize("ndim", [2, 3])
def test_a_box_of_a_stored_map_ends_before_hi_on_each_side(ndim: int, tmp_path: Path) -> None:
    """Of a full block of cells, so that a cell too many is one that is there."""
    size = 4
    places = np.stack(np.unravel_index(np.arange(size**ndim), (size,) * ndim), axis=1) - 2
    evidence = EvidenceMap(1.0, ndim=ndim)
    evidence.add_cells(places, np.arange(1, size**ndim + 1) * ONE, np.zeros(size**ndim, np.int64))
    evidence.save(tmp_path / "block.zarr")
    votes = votes_of(evidence)
    for axis in range(ndim):
        lo, hi = np.full(ndim, -2), np.full(ndim, 2)
        lo[axis], hi[axis] = -1, 1
        for low, high in ((lo, hi), (lo, None), (None, hi)):
            want = {
                cell: vote
                for cell, vote in votes.items()
                if (low is None or (cell >= low).all()) and (high is None or (cell < high).all())
            }
            assert len(want) == size ** (ndim - 1) * (3 if low is None or high is None else 2)
            assert votes_of(load_map(tmp_path / "block.zarr", lo=low, hi=high)) == want


@pytest.mark.parametrize(("ndim", "shard"), [(2, 1024), (3, 128)])
def test_a_box_of_a_stored_map_is_a_crop(ndim: int, shard: int, tmp_path: Path) -> None:
    """Cells on both sides of the borders of shards, and boxes that end or begin there."""
    cells = [-shard - 1, -shard, -1, 0, shard - 1, shard]
    places = np.zeros((len(cells), ndim), np.int64)
    for axis in range(ndim):
        places[:, axis] = cells
        evidence = EvidenceMap(1.0, ndim=ndim)
        evidence.add_cells(places, np.arange(1, 7), np.zeros(6, np.int64))
        evidence.save(tmp_path / f"{axis}.zarr")
        borders = (-shard, 0, shard)
        for a, b in [(at - 1, at) for at in borders] + [(at, at + 1) for at in borders]:
            lo, hi = np.full(ndim, -1), np.full(ndim, 1)
            lo[axis], hi[axis] = a, b
            part = load_map(tmp_path / f"{axis}.zarr", lo=lo, hi=hi)
            assert votes_of(part) == votes_of(evidence.crop(lo, hi))
            assert part.cell_count() == sum(a <= cell < b for cell in cells) == 1
        places[:, axis] = 0


@pytest.mark.parametrize(
    ("weight", "kind", "words"),
    [
        (-1, "<i8", "hits holds 'int64', which no map does"),
        (2**46 + 256, "<u8", "hits holds weights that are not counts"),
        (2**48, "<u8", "hits holds weights that are not counts"),
        (2**63, "<u8", "hits holds weights that are not counts"),
    ],
)
def test_stored_weights_that_are_no_counts_are_refused(
    weight: int, kind: str, words: str, tmp_path: Path
) -> None:
    """In whole votes here: 2^48 of them would wrap around to none."""
    import zarr

    evidence = EvidenceMap(0.25)
    evidence.add_cells(np.array([[3, 4]]), np.array([2 * ONE]), np.array([ONE]))
    path = tmp_path / "a.zarr"
    evidence.save(path)
    root: Any = zarr.open_group(path, mode="r+")
    for name in ("hits", "passes"):
        old = root[name]
        values, attributes = np.asarray(old[:]).astype(kind), dict(old.attrs)
        assert attributes["weight_unit"] == 1.0
        values[values == 2] = weight
        new = root.create_array(
            name, data=values, chunks=old.chunks, shards=old.shards, fill_value=0, overwrite=True
        )
        new.attrs.update(attributes)
    root.attrs["digest"] = None  # as who edits a map on purpose does
    with pytest.raises(InputError, match=words):
        load_map(path)
