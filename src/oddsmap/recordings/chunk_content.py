# SPDX-License-Identifier: Apache-2.0
"""The content of a compressed chunk, within the size that it states."""

from __future__ import annotations

import bz2
import io
import zlib
from collections.abc import Callable

from oddsmap.recordings.container import ChunkError, megabytes

__all__ = ["chunk_content"]

# What a chunk may hold [bytes]: this much, or this many times its own size. Recorders start a new
# chunk after 1 to 8 MB; one that grows a thousandfold is made to fill memory.
_ALWAYS_HELD = 64 * 1024 * 1024
_MAX_RATIO = 1000


def chunk_content(
    data: bytes, compression: str, size: int, crc: int = 0, *, cut: bool = False
) -> bytes:
    """Decompress a chunk.

    Args:
        data: its compressed bytes.
        compression: "none", "", "bz2", "lz4" or "zstd".
        size: of the content, as the chunk states it [bytes].
        crc: of the content; 0 where there is none.
        cut: the end of the chunk is missing: return as much of its content as there is.

    Raises:
        ChunkError: it is damaged, or of another compression.
    """
    if size > max(_ALWAYS_HELD, _MAX_RATIO * len(data)):
        raise ChunkError(
            f"a chunk of {megabytes(len(data))} states that it holds {megabytes(size)}"
        )
    if compression not in _DECOMPRESSORS:
        raise ChunkError(f"chunks compressed by {compression[:20]!r}, which is not read")
    try:
        # One byte more than is stated, so that more than that shows.
        content = _DECOMPRESSORS[compression](data, size + 1)
    except ImportError:
        raise ChunkError(
            f'chunks compressed by {compression}, which pip install "oddsmap[ros]" reads'
        ) from None
    except Exception as error:  # each library raises its own, and other ones with each release
        raise ChunkError(f"a damaged chunk ({compression}: {error})") from None
    if cut:
        return content[:size]
    if len(content) != size:
        raise ChunkError(f"a damaged chunk (its content is not the {size:,} bytes it states)")
    if crc and zlib.crc32(content) != crc:
        raise ChunkError("a damaged chunk (its checksum differs)")
    return content


def _plain(data: bytes, size: int) -> bytes:
    return data[:size]


def _bz2(data: bytes, size: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(data, size)


def _lz4(data: bytes, size: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    content: bytes = LZ4FrameDecompressor().decompress(data, size)
    return content


def _zstd(data: bytes, size: int) -> bytes:
    import zstandard

    # Chunks are not written with windows beyond 128 MiB, which is what the default allows.
    with zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data)) as reader:
        content: bytes = reader.read(size)
    return content


_DECOMPRESSORS: dict[str, Callable[[bytes, int], bytes]] = {
    "": _plain,
    "none": _plain,
    "bz2": _bz2,
    "lz4": _lz4,
    "zstd": _zstd,
}
