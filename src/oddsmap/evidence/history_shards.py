# SPDX-License-Identifier: Apache-2.0
"""The shards of a map with a history: arrays of one extent and one type for good.

Of 2^31 cells along each axis, the frame's origin in the middle, and of 64 bits in units of 1/65536
vote: whatever is added, no commit changes what the arrays are. Shards that hold nothing take no
room, and of numbers the zeros in front hardly any.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.store import attributes_of
from oddsmap.evidence.stored_tiles import Form, Place, stored_tiles
from oddsmap.kernels.units import FRACTION_BITS, ONE
from oddsmap.map_files.icechunk_snapshot import Snapshot
from oddsmap.map_files.shard_bytes import pack_shard, shard_index
from oddsmap.map_files.zarr_folder import (
    ARRAYS,
    CHUNK,
    CHUNKS_IN_SHARD,
    EVIDENCE_MAP,
    FORMAT_VERSION,
    SHARD,
)
from oddsmap.map_files.zarr_header import Header, array_header
from oddsmap.map_files.zarr_metadata import array_json, group_json
from oddsmap.map_files.zarr_shards import SavedChunks, SavedShards

__all__ = ["EXTENT", "HistoryShards", "header_of", "new_header_files", "packed", "place_of_cell_0"]

EXTENT = 1 << 31
"""Cells along each axis of the arrays."""

_FORMAT = "oddsmap map history"
_HEADER = "zarr.json"
# Shards that are asked for at once: a distant storage answers each after tens of milliseconds.
_AT_ONCE = 16


def place_of_cell_0(d: int) -> int:
    """The shard that begins with cell 0, along each axis, in shards."""
    return EXTENT // 2 // SHARD[d]


def new_header_files(like: Evidence) -> dict[str, bytes]:
    """What the group and the arrays of a map of these settings say of themselves, by file."""
    d = like.ndim
    first = np.full(d, -EXTENT // 2, np.int64)
    # Of what changes with each commit, where cells are known and where they came from, nothing.
    attributes = attributes_of(like, first, first, first + EXTENT)
    attributes |= {"format": _FORMAT, "provenance": []}
    files = {_HEADER: group_json(attributes).encode()}
    for stored in stored_tiles(like):
        for name, text in stored.texts.items():
            own = {"description": text, "weight_unit": 1 / ONE}
            shape = (EXTENT,) * d
            content = array_json(shape, SHARD[d], CHUNK[d], np.uint64, 0, own)
            files[f"{name}/{_HEADER}"] = content.encode()
    return files


def header_of(files: Mapping[str, bytes], name: str) -> Header:
    """What those files say.

    Args:
        files: `new_header_files`, or what was read.
        name: of the repository, for messages.

    Raises:
        InputError: they are of another program, or a later version.
        ValueError: they contradict themselves.
    """
    read = {key: json.loads(content) for key, content in files.items()}
    attributes: dict[str, Any] = read.pop(_HEADER).get("attributes", {})
    if attributes.get("format") != _FORMAT:
        raise InputError(f"{name}: an Icechunk repository, but not one of oddsmap")
    if attributes.get("format_version") != FORMAT_VERSION:
        raise InputError(f"{name}: of a newer format: update oddsmap")
    d = len(attributes["origin_cell"])
    arrays = {key.partition("/")[0]: zarr for key, zarr in read.items()}
    if any(zarr["shape"] != [EXTENT] * d for zarr in arrays.values()):
        raise ValueError(f"its arrays are not of {EXTENT} cells along each axis")
    return Header(
        attributes,
        np.array(attributes["origin_cell"], np.int64),
        (EXTENT,) * d,
        {array: array_header(array, zarr, d) for array, zarr in arrays.items()},
        {array: [] for array in arrays},
        {},
    )


class HistoryShards(SavedShards):
    """The shards of one commit.

    Args:
        name: of the repository.
        snapshot: the commit.

    Raises:
        InputError: as in `header_of`.
        ValueError: likewise.
    """

    def __init__(self, name: str, snapshot: Snapshot) -> None:
        keys = [_HEADER, *(f"{array}/{_HEADER}" for array in ARRAYS[EVIDENCE_MAP])]
        found = zip(keys, snapshot.read(keys), strict=True)
        files = {key: content for key, content in found if content is not None}
        if _HEADER not in files:
            raise InputError(f"{name}: an Icechunk repository, but there is no map in it")
        super().__init__(Path(name), header_of(files, name))
        self._snapshot = snapshot
        self._read: dict[str, bytes] = {}

    def places(self, names: Iterable[str]) -> list[Place]:
        """Where any of some arrays has a shard, in shards, z before y before x, in order."""
        return sorted({place for name in names for place in self._snapshot.places(name)})

    def read_into(self, evidence: Evidence, reached: IntArray | None) -> list[str]:
        """Add what shards hold to a map that has none of it yet.

        Args:
            evidence: the map.
            reached: the shards, counted from cell 0, shape (n, d), x first; None: all.

        Returns:
            The files that there are of them.

        Raises:
            ValueError: one is damaged.
        """
        names = list(self.header.arrays)
        places = self.places(names) if reached is None else places_of(reached)
        there = []
        for first in range(0, len(places), _AT_ONCE):
            some = places[first : first + _AT_ONCE]
            keys = [_key(name, place) for place in some for name in names]
            found = zip(keys, self._snapshot.read(keys), strict=True)
            self._read = {key: content for key, content in found if content is not None}
            there += list(self._read)
            for stored in stored_tiles(evidence):
                for place in some:
                    if any(_key(name, place) in self._read for name in stored.names):
                        stored.fill(*_whole(self.read(stored.names, place)))
        return there

    def _frames(self, name: str, place: Place) -> dict[int, bytes]:
        content = self._read.get(_key(name, place))
        count = CHUNKS_IN_SHARD[self.ndim]
        return {} if content is None else shard_index(content, count, _key(name, place))


def _whole(chunks: SavedChunks) -> tuple[SavedChunks, int]:
    """Chunks in whole votes, and the units of one, where they are: tiles of those are smaller."""
    if any((cells & np.uint64(ONE - 1)).any() for cells in chunks.cells):
        return chunks, 1
    return SavedChunks(chunks.first, [each >> FRACTION_BITS for each in chunks.cells]), ONE


class _Packed:
    """Shards that are packed, by their files; see `ShardFiles`."""

    def __init__(self, d: int) -> None:
        self.files: dict[str, bytes | None] = {}
        self._count = CHUNKS_IN_SHARD[d]

    def create(
        self, name: str, dtype: npt.DTypeLike, fill_value: float, attributes: Mapping[str, Any]
    ) -> None:
        """Nothing: the arrays are there, and stay as they are."""

    def write(self, name: str, place: Place, numbers: IntArray, chunks: npt.NDArray[Any]) -> None:
        content = pack_shard(numbers, chunks, self._count, 0)
        if content is not None:
            self.files[_key(name, place)] = content


def packed(evidence: Evidence) -> dict[str, bytes | None]:
    """The files of all shards of a map."""
    d = evidence.ndim
    first, files = np.full(d, -place_of_cell_0(d), np.int64), _Packed(d)
    for stored in stored_tiles(evidence):
        for shard in stored.shards(Form(1, np.dtype(np.uint64))):
            shard.write(files, first)
    return files.files


def places_of(reached: IntArray) -> list[Place]:
    """Places of shards, z before y before x, of those counted from cell 0, x first."""
    d = reached.shape[1]
    return [tuple(place) for place in (reached + place_of_cell_0(d))[:, ::-1].tolist()]


def _key(name: str, place: Place) -> str:
    return f"{name}/c/{'/'.join(map(str, place))}"
