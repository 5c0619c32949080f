# SPDX-License-Identifier: Apache-2.0
"""A saved map of which only the header has been read: parts of it when they are asked for."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.store import empty_map, fill_map, map_header
from oddsmap.map_files.zarr_folder import SHARD
from oddsmap.map_files.zarr_header import Header, whole_numbers
from oddsmap.map_files.zarr_shards import SavedShards
from oddsmap.map_files.zarr_snapshot import Mark, mark_of, read_unchanged

__all__ = ["SavedParts"]

E = TypeVar("E", bound=Evidence)

Place = tuple[int, ...]
"""Of a shard among those of the map, z before y before x."""


class SavedParts(Generic[E]):
    """A saved map, of which parts are read when they are asked for.

    Args:
        path: a folder that `save_map` wrote.
        kind: what to make of its parts.

    Attributes:
        like: an empty map of the same configuration and provenance.
        bounds: as `Evidence.bounds`, as the header has it.

    Raises:
        InputError: it is no map, or its header is damaged.
    """

    like: E

    def __init__(self, path: str | os.PathLike[str], kind: type[E]) -> None:
        self.path, self._kind = Path(path), kind

        def read() -> tuple[Mark | None, Header]:
            before = mark_of(self.path)
            header = map_header(self.path)
            self.like = empty_map(self.path, kind, header)
            return before, header

        self._mark, self._header = read_unchanged(self.path, read)
        self.bounds: tuple[IntArray, IntArray] | None = None
        if self.shard_count:
            lo, hi = (
                np.array(whole_numbers(self._header.attributes, f"known_cells_{end}"), np.int64)
                for end in ("lo", "hi")
            )
            self.bounds = lo, hi

    @property
    def shard_count(self) -> int:
        """How many shards hold something."""
        return len(set().union(*self._header.shards.values()))

    def place_of(self, cells: IntArray) -> IntArray:
        """The shards that hold cells, shape (n, d), x first; some may lie outside the map."""
        shards: IntArray = (cells - self._header.origin_cell) // SHARD[self.like.ndim]
        return shards

    def read_box(self, lo: IntArray, hi: IntArray) -> E:
        """The cells of a box: from lo on and before hi, shape (d,); errors as in `each`."""
        return self._unchanged(lambda shards, part: fill_map(part, shards, lo, hi))

    def read_shard(self, place: IntArray) -> E | None:
        """The cells of a shard; None: the map does not reach so far. Errors as in `each`."""
        own = tuple(place[::-1].tolist())
        count = tuple(n // SHARD[self.like.ndim] for n in self._header.shape)
        if not all(0 <= i < n for i, n in zip(own, count, strict=True)):
            return None
        return self._unchanged(
            lambda shards, part: fill_map(part, shards, None, None, places=[own])
        )

    def places(self) -> list[IntArray]:
        """The shards that hold something, as `read_shard` takes them, z before y before x.

        Raises:
            InputError: a file is missing, or the map was replaced since it was opened.
        """
        found: list[Place] = []

        def look(shards: SavedShards, _: E) -> None:
            found[:] = shards.places(self._header.arrays)

        self._unchanged(look)
        return [np.array(place[::-1], np.int64) for place in found]

    def each(self, take: Callable[[E], None]) -> None:
        """Give each shard's evidence, one at a time, to `take`; lengths after all votes.

        Raises:
            InputError: a shard is damaged or missing, or the map was replaced since it was opened.
        """
        self._unchanged(lambda shards, part: fill_map(part, shards, None, None, take=take))

    def _unchanged(self, fill: Callable[[SavedShards, E], None]) -> E:
        """What `fill` makes of an empty map, if the saved one is still the one that was opened."""

        def read() -> E:
            if mark_of(self.path) != self._mark:
                raise InputError(
                    f"{self.path}: has changed since it was opened: open it again"
                    if self.path.exists()
                    else f"{self.path}: is gone since it was opened"
                )
            part = self.like.like()
            part.provenance = list(self.like.provenance)
            fill(SavedShards(self.path, self._header), part)
            return part

        return read_unchanged(self.path, read)
