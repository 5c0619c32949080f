# SPDX-License-Identifier: Apache-2.0
"""Groups of shards: their owners add up what all chunks have given, and write it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from oddsmap.evidence.tiles import Census
from oddsmap.scale.answers import Refusal, answering
from oddsmap.scale.chunk_task import PartRef
from oddsmap.scale.map_places import Place
from oddsmap.scale.marked_place import check_marked
from oddsmap.scale.shard_records import Index, join, split
from oddsmap.scale.shard_sums import add_shards, as_stored

__all__ = ["FAN_IN", "GroupSum", "Stored", "add_group", "totals_of", "write_group"]

FAN_IN = 64
"""Parts that are added at a time, so that memory is bounded where all chunks saw one place."""


class GroupSum(NamedTuple):
    """A group that has been added up; itself a part, where there are more to add."""

    content: bytes
    votes: Census
    lengths: Census


class Stored(NamedTuple):
    """How an array of a map is stored."""

    dtype: str
    unit: int
    """Units of 1/65536 in one count."""


@answering
def add_group(
    place: Place, parts: Iterable[PartRef], sums: Iterable[GroupSum | Refusal], d: int
) -> GroupSum | Refusal:
    """A task: add up parts of one group.

    Args:
        place: where the parts are.
        parts: those that were written, each of another chunk.
        sums: those that were added up by other tasks, of other chunks.
        d: 2 or 3.
    """
    contents = []
    for each in sums:
        if isinstance(each, Refusal):
            return each
        contents.append(each.content)
    contents += [place.get(part.name, part.offset, part.length) for part in parts]
    found = add_shards([split(content) for content in contents], d)
    return GroupSum(join(found.shards), found.votes, found.lengths)


@answering
def totals_of(group: GroupSum | Refusal) -> tuple[Census, Census] | Refusal:
    """A task: what is in a group, votes and lengths, without the group itself."""
    return group if isinstance(group, Refusal) else (group.votes, group.lengths)


@answering
def write_group(
    group: GroupSum,
    stored: Mapping[str, Stored],
    first_place: Sequence[int],
    place: Place,
    folder: str,
    parts: str,
) -> list[tuple[str, Index]]:
    """A task: write the shards of a group as a saved map has them.

    Args:
        group: what was added up.
        stored: how each array of the map is stored.
        first_place: the first shard of the arrays, x first.
        place: where the map goes.
        folder: the beginning of its names.
        parts: likewise of the parts, where the place is marked.

    Returns:
        Names and places of the files, z before y before x, in shards from the first one.
    """
    check_marked(place, parts)
    written = []
    for shard in split(group.content):
        at = tuple(i - first for i, first in zip(shard.place, first_place, strict=True))[::-1]
        for name, array in shard.arrays.items():
            content = as_stored(array, *stored[name], len(at))
            place.put(f"{folder}/{name}/c/{'/'.join(map(str, at))}", content)
            written.append((name, at))
    return written
