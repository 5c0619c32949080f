# SPDX-License-Identifier: Apache-2.0
"""The shards of a saved map: which there are, whether they are whole, and their cells.

They are unpacked here and not by Zarr, which asks for whatever memory a chunk says that it needs,
and whose threads go on, and speak on stderr, after the first damaged chunk.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.map_files.zarr_folder import CHUNK, SHARD, shard_files
from oddsmap.map_files.zarr_header import Header

__all__ = ["SavedShards", "unpack_shard"]

_EMPTY = (1 << 64) - 1  # offset and length of a chunk that is not written
_ZSTD = b"\x28\xb5\x2f\xfd"
# Of a zstd frame's header: bytes of the field for its length, by two bits, and of the dictionary's.
_LENGTH_BYTES, _DICTIONARY_BYTES = (0, 2, 4, 8), (0, 1, 2, 4)
_FRAME_HEADER = 18
_CASTAGNOLI = 0x82F63B78


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


def unpack_shard(content: bytes, cells: npt.NDArray[Any], chunk: int, name: str) -> None:
    """Unpack the chunks of a shard that are written.

    Args:
        content: of the file: chunks as zstd frames, then their offsets and lengths as uint64, then
            the CRC-32C of those (Zarr's sharding_indexed).
        cells: filled, shape (side,) * d.
        chunk: side of a chunk [cells].
        name: of the file, for messages.

    Raises:
        ValueError: its index is damaged or leads outside it, or a chunk is damaged. One that says
            that it is of another size is not unpacked.
    """
    from numcodecs.zstd import Zstd

    d, dtype = cells.ndim, cells.dtype.newbyteorder("<")
    grid = (cells.shape[0] // chunk,) * d
    size, index_at = chunk**d * dtype.itemsize, len(content) - 16 * grid[0] ** d - 4
    if index_at < 0:
        raise ValueError(f"{name} has {len(content)} bytes, less than its index")
    if _crc32c(content[index_at:-4]) != int.from_bytes(content[-4:], "little"):
        raise ValueError(f"the index of {name} does not match its checksum")
    index = np.frombuffer(content[index_at:-4], "<u8").reshape(-1, 2).tolist()
    unpack = Zstd()
    for number, (start, length) in enumerate(index):
        if start == length == _EMPTY:
            continue
        if start + length > index_at:
            raise ValueError(f"a chunk of {name} lies outside the file")
        frame = content[start : start + length]
        if _unpacked_bytes(frame[:_FRAME_HEADER]) != size:
            raise ValueError(f"a chunk of {name} does not unpack to {size} bytes")
        try:
            block = np.frombuffer(unpack.decode(frame), dtype).reshape((chunk,) * d)
        except (RuntimeError, ValueError):
            raise ValueError(f"a chunk of {name} cannot be unpacked") from None
        at = np.unravel_index(number, grid)
        cells[tuple(slice(int(i) * chunk, (int(i) + 1) * chunk) for i in at)] = block


@cache
def _crc_table() -> list[int]:
    table = []
    for value in range(256):
        for _ in range(8):
            value = (value >> 1) ^ (_CASTAGNOLI if value & 1 else 0)
        table.append(value)
    return table


def _crc32c(content: bytes) -> int:
    """CRC-32C (Castagnoli) of some bytes; an index has a thousand."""
    table, value = _crc_table(), 0xFFFFFFFF
    for byte in content:
        value = (value >> 8) ^ table[(value ^ byte) & 0xFF]
    return value ^ 0xFFFFFFFF


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
