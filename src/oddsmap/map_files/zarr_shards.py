# SPDX-License-Identifier: Apache-2.0
"""The shards of a saved map: which there are, and their cells."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.map_files.shard_bytes import unpack_shard
from oddsmap.map_files.zarr_folder import CHUNK, SHARD, shard_files
from oddsmap.map_files.zarr_header import Header

__all__ = ["SavedShards"]


class SavedShards:
    """The shards of a map's arrays.

    Args:
        path: the map's folder.
        header: what it says of itself.
    """

    def __init__(self, path: Path, header: Header) -> None:
        self.path, self.header = path, header
        self.ndim = len(header.shape)

    def places(self, names: Iterable[str]) -> list[tuple[int, ...]]:
        """Where any of some arrays has a file, in shards, z before y before x, in order.

        Files that are not listed count as well: another process may have added them.

        Raises:
            ValueError: a file that was written is missing, or one lies outside the arrays.
        """
        found: set[tuple[int, ...]] = set()
        for name in names:
            files = {tuple(place) for place in shard_files(self.path, name, self.ndim)}
            # To Zarr a missing file is a shard of zeros; here it would be cells lost silently.
            missing = [place for place in self.header.shards[name] if place not in files]
            if missing:
                raise ValueError(f"{self._file(name, missing[0])} is missing or empty")
            found |= files
        grid = tuple(n // SHARD[self.ndim] for n in self.header.shape)
        for place in found:
            if any(i >= n for i, n in zip(place, grid, strict=True)):
                raise ValueError(f"a file of shard {place} lies outside the map")
        return sorted(found)

    def read(self, name: str, place: tuple[int, ...]) -> npt.NDArray[Any]:
        """All cells of a shard, shape (side,) * d; the fill value where it has no file.

        Raises:
            ValueError: it is damaged.
        """
        array = self.header.arrays[name]
        cells = np.full((SHARD[self.ndim],) * self.ndim, array.fill_value, array.dtype)
        file = self.path / self._file(name, place)
        if file.exists():
            if file.stat().st_size > 2 * cells.nbytes:  # what cannot be packed is hardly longer
                raise ValueError(f"{self._file(name, place)} is larger than its cells")
            unpack_shard(file.read_bytes(), cells, CHUNK[self.ndim], self._file(name, place))
        return cells

    def _file(self, name: str, place: tuple[int, ...]) -> str:
        return f"{name}/c/{'/'.join(map(str, place))}"
