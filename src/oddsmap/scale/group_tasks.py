# SPDX-License-Identifier: Apache-2.0
"""Groups of shards: their owners add up what all chunks have given, and write it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from oddsmap.evidence.stored_tiles import Form
from oddsmap.evidence.tiles import Census
from oddsmap.map_files.shard_bytes import shard_checksum
from oddsmap.map_files.zarr_folder import CHUNKS_IN_SHARD
from oddsmap.scale.answers import Refusal, answering
from oddsmap.scale.chunk_task import PartRef, Weights
from oddsmap.scale.map_places import Place
from oddsmap.scale.marked_place import check_marked
from oddsmap.scale.shard_records import (
    Index,
    PackedGroup,
    PackedShard,
    packed_group,
    split,
    totals_of,
)
from oddsmap.scale.shard_sums import add_shards

__all__ = ["FAN_IN", "Given", "WrittenGroup", "add_group", "weights_of", "write_group"]

FAN_IN = 64
"""Parts that are added at a time, so that memory is bounded where all chunks saw one place."""


@dataclass(frozen=True, slots=True)
class Given:
    """What a group is the sum of.

    Args:
        parts: those that were written, each of another chunk.
        d: 2 or 3.
    """

    parts: Sequence[PartRef]
    d: int


class WrittenGroup(NamedTuple):
    """A group that is in the map."""

    files: list[tuple[str, Index, int]]
    """Names of arrays, places, z before y before x, in shards from the first one, and checksums."""
    votes: Census
    lengths: Census


@answering
def add_group(
    place: Place, given: Given, sums: Iterable[PackedGroup | Refusal]
) -> PackedGroup | Refusal:
    """A task: add up parts of one group.

    Args:
        place: where the parts are.
        given: the parts.
        sums: what other tasks have added up, of other chunks.
    """
    found = _parts(place, given, sums)
    return found if isinstance(found, Refusal) else packed_group(add_shards(found, given.d))


@answering
def weights_of(group: PackedGroup | Refusal) -> tuple[Weights, Weights] | Refusal:
    """A task: what decides about forms, votes and lengths, without the group itself."""
    if isinstance(group, Refusal):
        return group
    return Weights.of(group.votes), Weights.of(group.lengths)


@answering
def write_group(
    place: Place,
    given: Given,
    sums: Iterable[PackedGroup | Refusal],
    forms: Mapping[str, Form],
    first_place: Sequence[int],
    folder: str,
    parts: str,
) -> WrittenGroup | Refusal:
    """A task: add up a group, and write its shards as a saved map has them.

    Args:
        place: where the parts are, and the map goes.
        given: the parts.
        sums: what other tasks have added up, of other chunks.
        forms: of the arrays of the map.
        first_place: the first shard of the arrays, x first.
        folder: the beginning of the map's names.
        parts: likewise of the parts, where the place is marked.
    """
    check_marked(place, parts)
    found = _parts(place, given, sums)
    if isinstance(found, Refusal):
        return found
    files, shards = [], add_shards(found, given.d, forms)
    count = CHUNKS_IN_SHARD[given.d]
    contents: dict[str, bytes] = {}
    for shard in shards:
        at = tuple(i - first for i, first in zip(shard.place, first_place, strict=True))[::-1]
        for name, array in shard.arrays.items():
            contents[f"{folder}/{name}/c/{'/'.join(map(str, at))}"] = array.content
            files.append((name, at, shard_checksum(array.content, count)))
    place.put_all(contents)
    return WrittenGroup(files, *totals_of(shards))


def _parts(
    place: Place, given: Given, sums: Iterable[PackedGroup | Refusal]
) -> list[list[PackedShard]] | Refusal:
    contents = []
    for each in sums:
        if isinstance(each, Refusal):
            return each
        contents.append(each.content)
    contents += place.get_all([(part.name, part.offset, part.length) for part in given.parts])
    return [split(content) for content in contents]
