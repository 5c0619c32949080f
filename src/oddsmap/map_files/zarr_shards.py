# SPDX-License-Identifier: Apache-2.0
"""The shards of a saved map: which there are, whether they are whole, and their cells."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.map_files.zarr_folder import CHUNK, SHARD, shard_files
from oddsmap.map_files.zarr_header import Header

__all__ = ["SavedShards", "check_shard"]

_EMPTY = (1 << 64) - 1  # offset and length of a chunk that is not written
_ZSTD = b"\x28\xb5\x2f\xfd"
# Of a zstd frame's header: bytes of the field for its length, by two bits, and of the dictionary's.
_LENGTH_BYTES, _DICTIONARY_BYTES = (0, 2, 4, 8), (0, 1, 2, 4)
_FRAME_HEADER = 18


class SavedShards:
    """The shards of a map's arrays.

    Args:
        path: the map's folder.
        header: what it says of itself.
    """

    def __init__(self, path: Path, header: Header) -> None:
        import zarr

        self.path, self.header = path, header
        self.ndim = len(header.shape)
        self._root = zarr.open_group(path, mode="r", zarr_format=3)

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
        """All cells of a shard, shape (side,) * d; the fill value where it has no file."""
        side, chunk = SHARD[self.ndim], CHUNK[self.ndim]
        dtype = self.header.arrays[name].dtype
        file = self.path / self._file(name, place)
        if file.exists():
            count, size = (side // chunk) ** self.ndim, chunk**self.ndim * dtype.itemsize
            check_shard(file, chunks=count, chunk_bytes=size)
        cut = tuple(slice(i * side, (i + 1) * side) for i in place)
        array: Any = self._root[name]
        cells = np.asarray(array[cut])
        if cells.shape != (side,) * self.ndim or cells.dtype != dtype:
            raise ValueError(f"{self._file(name, place)} holds {cells.shape} {cells.dtype}")
        return cells

    def _file(self, name: str, place: tuple[int, ...]) -> str:
        return f"{name}/c/{'/'.join(map(str, place))}"


def check_shard(file: Path, *, chunks: int, chunk_bytes: int) -> None:
    """Check that a shard unpacks to no more than it should, before it is unpacked.

    Args:
        file: the shard.
        chunks: how many it has room for.
        chunk_bytes: what each unpacks to.

    Raises:
        ValueError: its index leads outside it, or a chunk says that it is of another size.
    """
    with file.open("rb") as content:
        size = os.fstat(content.fileno()).st_size
        index_bytes = 16 * chunks
        if size < index_bytes + 4:
            raise ValueError(f"{file.name} has {size} bytes, less than its index")
        content.seek(size - index_bytes - 4)
        index = np.frombuffer(content.read(index_bytes), "<u8").reshape(-1, 2).tolist()
        for start, length in index:
            if start == length == _EMPTY:
                continue
            if start + length > size:
                raise ValueError(f"a chunk of {file.name} lies outside the file")
            content.seek(start)
            if _unpacked_bytes(content.read(min(length, _FRAME_HEADER))) != chunk_bytes:
                raise ValueError(f"a chunk of {file.name} does not unpack to {chunk_bytes} bytes")


def _unpacked_bytes(frame: bytes) -> int | None:
    """What a zstd frame says that it unpacks to (RFC 8878, 3.1.1.1); None where it does not."""
    if len(frame) < 6 or frame[:4] != _ZSTD:
        return None
    flags = frame[4]
    alone = bool(flags & 0x20)  # one segment, without the window's size
    length = _LENGTH_BYTES[flags >> 6] or int(alone)
    at = 5 + (not alone) + _DICTIONARY_BYTES[flags & 3]
    if length == 0 or len(frame) < at + length:
        return None
    return int.from_bytes(frame[at : at + length], "little") + (256 if length == 2 else 0)
