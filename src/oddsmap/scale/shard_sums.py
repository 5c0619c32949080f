# SPDX-License-Identifier: Apache-2.0
"""Packed shards added up, shard by shard, exactly, in the memory of one shard."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.errors import MapTooLargeError
from oddsmap.evidence.tiles import HEAVIEST, NOTHING, Census
from oddsmap.kernels.units import FRACTION_BITS, ONE
from oddsmap.map_files.shard_bytes import pack_shard, shard_index, unpack_chunk
from oddsmap.map_files.zarr_folder import CHUNK, SHARD
from oddsmap.scale.shard_records import LENGTHS, VOTES, Index, PackedArray, PackedShard

__all__ = ["Stored", "add_shards", "as_stored"]

Cells = npt.NDArray[Any]


class Stored(NamedTuple):
    """How an array of a map is stored."""

    dtype: str
    unit: int
    """Units of 1/65536 in one count: 65536 only where all weights are whole votes."""


def add_shards(
    parts: Iterable[Sequence[PackedShard]], d: int, stored: Mapping[str, Stored] | None = None
) -> list[PackedShard]:
    """Add up parts of maps.

    Args:
        parts: shards of each part.
        d: 2 or 3.
        stored: how each array of the sums is to be packed; None: each as its numbers need it.

    Raises:
        MapTooLargeError: a cell would pass 2^46 votes.
        ValueError: a part is damaged.
    """
    by_place: dict[Index, list[PackedShard]] = {}
    for part in parts:
        for shard in part:
            by_place.setdefault(shard.place, []).append(shard)
    return [_added(place, by_place[place], d, stored) for place in sorted(by_place)]


def _added(
    place: Index, shards: list[PackedShard], d: int, stored: Mapping[str, Stored] | None
) -> PackedShard:
    arrays: dict[str, PackedArray] = {}
    censuses = []
    for names, own in (
        (VOTES, [shard.votes for shard in shards]), (LENGTHS, [shard.lengths for shard in shards])
    ):  # fmt: skip
        there = [shard.arrays for shard, census in zip(shards, own, strict=True) if census.cells]
        if len(there) > 1:
            summed, census = _add(place, there, names, d, stored)
        else:  # most are seen by one chunk alone
            alone = there[0] if there else {}
            summed = {name: alone[name] for name in names if name in alone}
            if stored is not None:
                summed = {name: as_stored(a, stored[name], d) for name, a in summed.items()}
            census = next((each for each in own if each.cells), NOTHING)
        arrays |= summed
        censuses.append(census)
    return PackedShard(place, arrays, *censuses)


def _add(
    place: Index,
    parts: list[dict[str, PackedArray]],
    names: tuple[str, ...],
    d: int,
    stored: Mapping[str, Stored] | None,
) -> tuple[dict[str, PackedArray], Census]:
    """Add up some arrays of one shard, which are counted together."""
    given = {name: [part[name] for part in parts if name in part] for name in names}
    count = (SHARD[d] // CHUNK[d]) ** d
    frames = {
        name: [shard_index(array.content, count, name) for array in arrays]
        for name, arrays in given.items()
    }
    numbers = np.array(sorted(set().union(*(f for of_name in frames.values() for f in of_name))))
    numbers = numbers.astype(np.int64)
    units = {array.unit for arrays in given.values() for array in arrays}
    unit = ONE if units <= {ONE} else 1
    sums = [_sum(given[name], frames[name], numbers, unit, d) for name in names]
    census = _census(place, numbers, sums, unit, d)
    if census.largest > HEAVIEST:
        raise MapTooLargeError(
            "a cell's weight would pass 2^46 votes (2^62 units): "
            "the same evidence has been added many times over"
        )
    own = Stored(np.min_scalar_type(census.largest // unit).name, unit)
    packed = {}
    for name, cells in zip(names, sums, strict=True):
        how = own if stored is None else stored[name]
        content = pack_shard(numbers, _counted(cells, unit, how), count, 0)
        if content is not None:
            packed[name] = PackedArray(*how, content)
    return packed, census


def _counted(cells: Cells, unit: int, stored: Stored) -> Cells:
    """Counts of another unit and type, which hold them."""
    if unit != stored.unit:
        cells = cells.astype(np.uint64) * np.uint64(unit) // np.uint64(stored.unit)
    return cells.astype(stored.dtype, copy=False)


def _sum(
    arrays: list[PackedArray], frames: list[dict[int, bytes]], numbers: IntArray, unit: int, d: int
) -> Cells:
    """Add up one array, in units of `unit`: cells of each chunk, shape (n, chunk^d)."""
    most = sum(int(np.iinfo(array.dtype).max) * (array.unit // unit) for array in arrays)
    wide = most > np.iinfo(np.uint64).max
    total = np.zeros((len(numbers), CHUNK[d] ** d), np.uint64 if wide else np.min_scalar_type(most))
    row_of = {number: row for row, number in enumerate(numbers.tolist())}
    heaviest = 0
    for array, own in zip(arrays, frames, strict=True):
        cells = np.empty(CHUNK[d] ** d, array.dtype)
        shift = (array.unit // unit).bit_length() - 1
        largest = 0
        for number, frame in own.items():
            unpack_chunk(frame, cells, "a part of a map")
            largest = max(largest, int(cells.max())) if wide else 0
            total[row_of[number]] += cells.astype(total.dtype, copy=False) << shift
        heaviest += largest << shift
    if heaviest > np.iinfo(np.uint64).max:
        raise MapTooLargeError("a cell's weight would pass 2^46 votes by far: damaged parts")
    return total


def _census(place: Index, numbers: IntArray, sums: list[Cells], unit: int, d: int) -> Census:
    if not len(numbers):
        return NOTHING
    known = np.logical_or.reduce([cells != 0 for cells in sums])
    bounds = None
    if known.any():
        chunk, grid = CHUNK[d], SHARD[d] // CHUNK[d]
        at = np.stack(np.unravel_index(numbers, (grid,) * d)[::-1], axis=1)
        first = np.array(place, np.int64) * SHARD[d] + at * chunk
        box = known.reshape(-1, *(chunk,) * d)
        lo, hi = np.empty(d, np.int64), np.empty(d, np.int64)
        for axis in range(d):
            others = tuple(1 + other for other in range(d) if other != d - 1 - axis)
            row, within = np.nonzero(box.any(axis=others))
            lo[axis] = (first[row, axis] + within).min()
            hi[axis] = (first[row, axis] + within).max() + 1
        bounds = lo, hi
    if unit != ONE:  # narrow numbers know no 65536
        sums = [cells.astype(np.uint64) for cells in sums]
    totals = [_total(cells, unit) for cells in sums]
    fraction = unit != ONE and any(bool((cells % ONE).any()) for cells in sums)
    return Census(
        cells=int(np.count_nonzero(known)),
        hits=totals[0] if len(sums) == 2 else 0,
        passes=totals[-1],
        largest=max(int(cells.max()) for cells in sums) * unit,
        whole_votes=not fraction,
        bounds=bounds,
    )


def _total(cells: Cells, unit: int) -> int:
    if unit == ONE:
        return int(cells.sum(dtype=np.uint64)) << FRACTION_BITS
    whole, rest = (part.sum(dtype=np.uint64) for part in (cells >> FRACTION_BITS, cells % ONE))
    return (int(whole) << FRACTION_BITS) + int(rest)


def as_stored(array: PackedArray, stored: Stored, d: int) -> PackedArray:
    """The same array with the type and the unit of the whole map.

    Args:
        array: of one shard.
        stored: which hold each of its numbers.
        d: 2 or 3.
    """
    if (array.dtype, array.unit) == stored:
        return array
    count = (SHARD[d] // CHUNK[d]) ** d
    frames = shard_index(array.content, count, "a part of a map")
    cells = np.empty((len(frames), CHUNK[d] ** d), array.dtype)
    for row, frame in zip(cells, frames.values(), strict=True):
        unpack_chunk(frame, row, "a part of a map")
    numbers = np.array(list(frames), np.int64)
    content = pack_shard(numbers, _counted(cells, array.unit, stored), count, 0)
    assert content is not None, "no array without a weight is kept"  # noqa: S101
    return PackedArray(*stored, content)
