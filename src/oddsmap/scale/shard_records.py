# SPDX-License-Identifier: Apache-2.0
"""Parts of maps on their way: packed shards, one after the other, by groups of shards.

A shard is packed as in a saved map (`oddsmap.map_files.shard_bytes`), with as few bytes a number as
its own weights need. All maps of a resolution have one grid of shards, so the same shard of many
parts adds up to the shard of the map.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.stored_tiles import VOTES, Form, StoredShard, stored_tiles
from oddsmap.evidence.tiles import NOTHING, Census
from oddsmap.map_files.shard_bytes import pack_shard
from oddsmap.map_files.zarr_folder import CHUNKS_IN_SHARD

__all__ = [
    "GROUP", "Index", "PackedArray", "PackedGroup", "PackedShard",
    "packed_group", "packed_groups", "split", "totals_of",
]  # fmt: skip

GROUP = {2: 1, 3: 4}
"""Side of a group of shards, which has one owner: 51 m for 2D maps of 0.05 m, 3D ones of 0.1 m."""

# Of the JSON: its length and its CRC-32; contents have checksums of their own.
_BEGIN = struct.Struct("<QI")

Index = tuple[int, ...]


class PackedArray(NamedTuple):
    """One array of a shard."""

    dtype: str
    """Of its numbers, unsigned."""
    unit: int
    """Units of 1/65536 in one count: 1, or 65536."""
    content: bytes
    """As `oddsmap.map_files.shard_bytes.pack_shard` makes it."""


class PackedShard(NamedTuple):
    """What there is of one shard."""

    place: Index
    """In shards from cell 0, shape (d,), x first."""
    arrays: dict[str, PackedArray]
    """By their names; one without a weight is not there."""
    votes: Census
    """What is in it: whoever has only this of a shard need not unpack it."""
    lengths: Census


class PackedGroup(NamedTuple):
    """What there is of a group of shards."""

    content: bytes
    """What `split` takes."""
    votes: Census
    lengths: Census


def packed_groups(evidence: Evidence) -> dict[Index, PackedGroup]:
    """A map, by groups of shards.

    Returns:
        What there is of each, by its place in groups from cell 0, x first.
    """
    shards: dict[Index, PackedShard] = {}
    for stored in stored_tiles(evidence):
        for shard in stored.shards(Form.narrowest(stored.tiles.census())):
            own = _packed(shard)
            if own.arrays:
                beside = shards.get(own.place)
                shards[own.place] = own if beside is None else _together(beside, own)
    groups: dict[Index, list[PackedShard]] = {}
    for place in sorted(shards):
        group = tuple(i // GROUP[evidence.ndim] for i in place)
        groups.setdefault(group, []).append(shards[place])
    return {group: packed_group(of_group) for group, of_group in groups.items()}


def _packed(shard: StoredShard) -> PackedShard:
    d, (unit, dtype) = shard.of.tiles.ndim, shard.form
    arrays = {}
    for name, chunks in shard.arrays():
        content = pack_shard(shard.blocks.numbers, chunks, CHUNKS_IN_SHARD[d], 0)
        if content is not None:
            arrays[name] = PackedArray(dtype.name, unit, content)
    census = shard.of.tiles.census(shard.blocks.blocks)
    votes, lengths = (census, NOTHING) if shard.of.texts is VOTES else (NOTHING, census)
    return PackedShard(tuple(shard.blocks.place.tolist()), arrays, votes, lengths)


def _together(one: PackedShard, other: PackedShard) -> PackedShard:
    """Arrays of one kind, and of the other."""
    votes, lengths = one.votes.joined(other.votes), one.lengths.joined(other.lengths)
    return PackedShard(one.place, one.arrays | other.arrays, votes, lengths)


def packed_group(shards: Sequence[PackedShard]) -> PackedGroup:
    """Packed shards as bytes: JSON of what they are, behind its length and CRC-32, and contents."""
    head, contents = [], []
    for shard in shards:
        arrays = [[name, a.dtype, a.unit, len(a.content)] for name, a in shard.arrays.items()]
        head.append([shard.place, arrays, _listed(shard.votes), _listed(shard.lengths)])
        contents += [array.content for array in shard.arrays.values()]
    text = json.dumps(head, separators=(",", ":")).encode()
    content = b"".join([_BEGIN.pack(len(text), crc32(text)), text, *contents])
    return PackedGroup(content, *totals_of(shards))


def totals_of(shards: Sequence[PackedShard]) -> tuple[Census, Census]:
    """What is in shards: votes, and lengths."""
    votes, lengths = NOTHING, NOTHING
    for shard in shards:
        votes, lengths = votes.joined(shard.votes), lengths.joined(shard.lengths)
    return votes, lengths


def _listed(census: Census) -> list[Any]:
    bounds = census.bounds and [end.tolist() for end in census.bounds]
    return [*census[:-1], bounds]


def _census(listed: list[Any]) -> Census:
    cells, hits, passes, largest, whole_votes, bounds = listed
    if bounds is not None:
        bounds = np.array(bounds[0], np.int64), np.array(bounds[1], np.int64)
    return Census(cells, hits, passes, largest, whole_votes, bounds)


def split(content: bytes) -> list[PackedShard]:
    """The shards of a `PackedGroup`.

    Raises:
        ValueError: it is damaged.
    """
    try:
        length, checksum = _BEGIN.unpack_from(content)
        at = _BEGIN.size + length
        text = content[_BEGIN.size : at]
        if crc32(text) != checksum:
            raise ValueError("its checksum is another")
        shards = []
        for place, listed, votes, lengths in json.loads(text):
            arrays = {}
            for name, dtype, unit, size in listed:
                arrays[name] = PackedArray(dtype, unit, content[at : at + size])
                at += size
            shard = PackedShard(tuple(place), arrays, _census(votes), _census(lengths))
            shards.append(shard)
    except (struct.error, ValueError, TypeError) as error:
        raise ValueError(f"a part of a map is damaged ({error})") from None
    if at != len(content):
        raise ValueError(f"a part of a map has {len(content)} bytes, and says {at}")
    return shards
