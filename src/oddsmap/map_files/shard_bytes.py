# SPDX-License-Identifier: Apache-2.0
"""The bytes of a shard: chunks as zstd frames, then their offsets and lengths, then a checksum.

That is Zarr's codec sharding_indexed, with its index at the end: offset and length of each chunk as
uint64, and the CRC-32C of those. Shards are packed and unpacked here and not by Zarr: it takes
0.35 ms a chunk beside the compression itself, asks for whatever memory a damaged chunk says that it
needs, and has threads that go on, and speak on stderr, after the first damaged chunk.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["pack_shard", "unpack_shard"]

_EMPTY = (1 << 64) - 1  # offset and length of a chunk that is not written
_ZSTD = b"\x28\xb5\x2f\xfd"
# Of a zstd frame's header: bytes of the field for its length, by two bits, and of the dictionary's.
_LENGTH_BYTES, _DICTIONARY_BYTES = (0, 2, 4, 8), (0, 1, 2, 4)
_FRAME_HEADER = 18
_CASTAGNOLI = 0x82F63B78


def pack_shard(cells: npt.NDArray[Any], chunk: int, fill_value: float) -> bytes | None:
    """Pack a shard; chunks that hold nothing but the fill value are left out.

    Args:
        cells: shape (side,) * d.
        chunk: side of a chunk [cells].
        fill_value: of the array.

    Returns:
        What `unpack_shard` takes; None where no chunk is left.
    """
    from numcodecs.zstd import Zstd

    pack = Zstd(level=0, checksum=True)
    grid = (cells.shape[0] // chunk,) * cells.ndim
    little = cells.astype(cells.dtype.newbyteorder("<"), copy=False)
    fill = little.dtype.type(fill_value)
    index = np.full((grid[0] ** cells.ndim, 2), _EMPTY, "<u8")
    frames, at = [], 0
    for number, place in enumerate(np.ndindex(grid)):
        block = little[tuple(slice(i * chunk, (i + 1) * chunk) for i in place)]
        if not (block != fill).any():
            continue
        frame = bytes(pack.encode(np.ascontiguousarray(block)))
        index[number] = at, len(frame)
        frames.append(frame)
        at += len(frame)
    if not frames:
        return None
    end = index.tobytes()
    return b"".join([*frames, end, _crc32c(end).to_bytes(4, "little")])


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
