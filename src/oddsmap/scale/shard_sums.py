# SPDX-License-Identifier: Apache-2.0
"""Packed shards added up, shard by shard, exactly, in the memory of one shard."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.errors import MapTooLargeError
from oddsmap.evidence.stored_tiles import LENGTHS, VOTES, Form
from oddsmap.evidence.tiles import HEAVIEST, NOTHING, Census
from oddsmap.kernels.units import ONE
from oddsmap.map_files.shard_bytes import pack_shard, shard_index, unpack_chunk
from oddsmap.map_files.zarr_folder import CHUNK, CHUNKS_IN_SHARD
from oddsmap.scale.shard_records import Index, PackedArray, PackedShard

__all__ = ["add_shards", "in_form"]

Cells = npt.NDArray[Any]


def add_shards(
    parts: Iterable[Sequence[PackedShard]], d: int, forms: Mapping[str, Form] | None = None
) -> list[PackedShard]:
    """Add up parts of maps.

    Args:
        parts: shards of each part.
        d: 2 or 3.
        forms: of the arrays of the sums; None: each as narrow as its numbers are.

    Raises:
        MapTooLargeError: a cell would pass 2^46 votes.
        ValueError: a part is damaged.
    """
    by_place: dict[Index, list[PackedShard]] = {}
    for part in parts:
        for shard in part:
            by_place.setdefault(shard.place, []).append(shard)
    return [_added(place, by_place[place], d, forms) for place in sorted(by_place)]


def _added(
    place: Index, shards: list[PackedShard], d: int, forms: Mapping[str, Form] | None
) -> PackedShard:
    arrays: dict[str, PackedArray] = {}
    censuses = []
    for names, own in (
        (VOTES, [shard.votes for shard in shards]), (LENGTHS, [shard.lengths for shard in shards])
    ):  # fmt: skip
        with_own = zip(shards, own, strict=True)
        there = [(shard.arrays, census) for shard, census in with_own if census.cells]
        if len(there) > 1:
            summed, census = _add(there, names, d, forms)
        else:  # most are seen by one chunk alone
            alone, census = there[0] if there else ({}, NOTHING)
            summed = {name: alone[name] for name in names if name in alone}
            if forms is not None:
                summed = {name: in_form(a, forms[name], d) for name, a in summed.items()}
        arrays |= summed
        censuses.append(census)
    return PackedShard(place, arrays, *censuses)


def _add(
    parts: list[tuple[dict[str, PackedArray], Census]],
    names: Iterable[str],
    d: int,
    forms: Mapping[str, Form] | None,
) -> tuple[dict[str, PackedArray], Census]:
    """Add up some arrays of one shard, which are counted together."""
    given = {name: [arrays[name] for arrays, _ in parts if name in arrays] for name in names}
    count = CHUNKS_IN_SHARD[d]
    frames = {
        name: [shard_index(array.content, count, name) for array in arrays]
        for name, arrays in given.items()
    }
    numbers = np.array(sorted(set().union(*(f for of_name in frames.values() for f in of_name))))
    numbers = numbers.astype(np.int64)
    units = {array.unit for arrays in given.values() for array in arrays}
    unit = ONE if units <= {ONE} else 1
    most = sum(census.largest for _, census in parts) // unit
    sums = [_sum(given[name], frames[name], numbers, unit, most, d) for name in names]
    census = _census(sums, unit, [census for _, census in parts])
    own = Form.narrowest(census)
    packed = {}
    for name, cells in zip(names, sums, strict=True):
        form = own if forms is None else forms[name]
        content = pack_shard(numbers, _counted(cells, unit, form), count, 0)
        if content is not None:
            packed[name] = PackedArray(form.dtype.name, form.unit, content)
    return packed, census


def _counted(cells: Cells, unit: int, form: Form) -> Cells:
    """Counts of another unit and type, which hold them."""
    if unit != form.unit:
        cells = cells.astype(np.uint64) * np.uint64(unit) // np.uint64(form.unit)
    return cells.astype(form.dtype, copy=False)


def _sum(
    arrays: list[PackedArray],
    frames: list[dict[int, bytes]],
    numbers: IntArray,
    unit: int,
    most: int,
    d: int,
) -> Cells:
    """Add up one array, in units of `unit`, of which no cell has more than `most`.

    Returns:
        Cells of each chunk, shape (n, chunk^d).
    """
    limit = HEAVIEST // unit
    total = np.zeros((len(numbers), CHUNK[d] ** d), np.min_scalar_type(min(most, 2 * limit)))
    row_of = {number: row for row, number in enumerate(numbers.tolist())}
    for array, own in zip(arrays, frames, strict=True):
        cells = np.empty(CHUNK[d] ** d, array.dtype)
        shift = (array.unit // unit).bit_length() - 1
        for number, frame in own.items():
            unpack_chunk(frame, cells, "a part of a map")
            total[row_of[number]] += cells.astype(total.dtype) << shift if shift else cells
        if most > limit and total.max(initial=0) > limit:
            raise MapTooLargeError(
                "a cell's weight would pass 2^46 votes (2^62 units): "
                "the same evidence has been added many times over"
            )
    return total


def _census(sums: list[Cells], unit: int, parts: list[Census]) -> Census:
    """What is in a sum: some of it is the sum of what was in the parts."""
    joined = reduce(Census.joined, parts)
    whole_votes = joined.whole_votes or not any(
        (cells & np.uint64(ONE - 1)).any() for cells in sums
    )
    return joined._replace(
        cells=int(np.count_nonzero(np.bitwise_or.reduce(sums))),
        largest=max(int(cells.max(initial=0)) for cells in sums) * unit,
        whole_votes=whole_votes,
    )


def in_form(array: PackedArray, form: Form, d: int) -> PackedArray:
    """The same array in the form that it has in the whole map.

    Args:
        array: of one shard.
        form: which holds each of its numbers.
        d: 2 or 3.
    """
    if (array.dtype, array.unit) == (form.dtype.name, form.unit):
        return array
    count = CHUNKS_IN_SHARD[d]
    frames = shard_index(array.content, count, "a part of a map")
    cells = np.empty((len(frames), CHUNK[d] ** d), array.dtype)
    for row, frame in zip(cells, frames.values(), strict=True):
        unpack_chunk(frame, row, "a part of a map")
    numbers = np.array(list(frames), np.int64)
    content = pack_shard(numbers, _counted(cells, array.unit, form), count, 0)
    assert content is not None, "no array without a weight is kept"  # noqa: S101
    return PackedArray(form.dtype.name, form.unit, content)
