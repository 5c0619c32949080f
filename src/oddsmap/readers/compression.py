# SPDX-License-Identifier: Apache-2.0
"""Files as their content: gzip and bzip2 are undone by their magic bytes, whatever the suffix."""

from __future__ import annotations

import bz2
import os
import zlib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from oddsmap.errors import InputError
from oddsmap.limits import check_content_size
from oddsmap.scans.note import Note

__all__ = ["HEAD_SIZE", "TRUNCATED", "Source", "open_source"]

# What a reader may look at to recognize its format [bytes]. A CARMEN log can start with some
# hundred PARAM lines (9 KB in belgioioso), which are enough to know it by.
HEAD_SIZE = 64 * 1024

# The reason under which a container that ends early is counted.
TRUNCATED = "container.truncated"

# What a container may hold [bytes]: this much, or this many times its own size. Text logs shrink to
# a tenth; a file that shrinks to a thousandth is zeros, or made to fill memory.
_ALWAYS_HELD = 256 * 1024 * 1024
_MAX_RATIO = 100

# A decompressor that meets a damaged byte throws away the output of the whole call, so that the
# size of a call [bytes] bounds what is lost of a corrupt gzip file.
_PIECE_SIZE = 4096


@dataclass(frozen=True, slots=True)
class Source:
    """The decompressed content of a file.

    Args:
        path: the file, as the caller wrote it: what messages start with.
        content: all bytes after decompression.
        damage: what is wrong with the container of which `content` is the readable part, or None.
    """

    path: str
    content: bytes
    damage: str | None = None

    @property
    def head(self) -> bytes:
        """The first bytes of the content, by which a reader recognizes its format."""
        return self.content[:HEAD_SIZE]

    def initial_skipped(self) -> Counter[str]:
        """The counter a reader starts from: a damaged container is one counted skip."""
        return Counter({TRUNCATED: 1}) if self.damage else Counter()

    def initial_notes(self) -> list[Note]:
        """The notes a reader starts from."""
        if not self.damage:
            return []
        text = f"{self.damage}: only the readable part was used"
        return [Note(text, code=TRUNCATED, severity="warning")]


def open_source(path: str | os.PathLike[str], *, skip_bad: bool = False) -> Source:
    """Read a file and undo its gzip or bzip2 compression.

    Args:
        path: the file.
        skip_bad: use the readable part of a truncated or corrupt container.

    Returns:
        The content; its `damage` says what was wrong with the container.

    Raises:
        InputError: the file is missing, a directory, unreadable, empty or larger than memory could
            hold (also when it is decompressed), or its container is damaged and `skip_bad` is
            false, or nothing of it can be read, or it holds so much more than its size as no log
            does.
    """
    name = os.fspath(path)
    raw = _read_bytes(Path(path), name)
    for compression, magic, new_stream in _COMPRESSIONS:
        if raw.startswith(magic):
            content, damage = _decompress(name, raw, compression, magic, new_stream)
            break
    else:
        content, damage = raw, None
    if damage and not skip_bad:
        raise InputError(
            f"{name}: {damage} after {len(content)} bytes of content: "
            "copy the file again, or use its readable part with --skip-bad (skip_bad=True)"
        )
    if damage and not content:
        raise InputError(f"{name}: {damage} and nothing in it can be read: copy the file again")
    if not content:
        raise InputError(f"{name}: the file is empty: check how it was written or copied")
    return Source(name, content, damage)


def _read_bytes(path: Path, name: str) -> bytes:
    try:
        check_content_size(name, path.stat().st_size, "the file")
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{name}: no such file: check the path") from None
    except IsADirectoryError:
        raise InputError(
            f"{name}: is a directory, a log is one file: give the path of a file in it"
        ) from None
    except InputError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the path
        what = getattr(error, "strerror", None) or error
        raise InputError(
            f"{name}: cannot be read ({what}): check the file and its permissions"
        ) from None


class _Stream(Protocol):
    @property
    def eof(self) -> bool: ...
    @property
    def unused_data(self) -> bytes: ...
    def decompress(self, data: bytes, max_length: int, /) -> bytes: ...


class _NewStream(Protocol):
    def __call__(self) -> _Stream: ...


def _new_gzip_stream() -> _Stream:
    return zlib.decompressobj(wbits=16 + zlib.MAX_WBITS)


_COMPRESSIONS: tuple[tuple[str, bytes, _NewStream], ...] = (
    ("gzip", b"\x1f\x8b", _new_gzip_stream),
    ("bzip2", b"BZh", bz2.BZ2Decompressor),
)


def _decompress(
    name: str, raw: bytes, compression: str, magic: bytes, new_stream: _NewStream
) -> tuple[bytes, str | None]:
    """Undo one compression; returns the content and what is wrong with the container."""
    parts: list[bytes] = []
    most = left = max(_ALWAYS_HELD, _MAX_RATIO * len(raw))
    stream = new_stream()
    position = size = 0
    try:
        while position < len(raw):
            piece = raw[position : position + _PIECE_SIZE]
            position += len(piece)
            # One byte more than may come, so that an output of all that may is no question.
            parts.append(stream.decompress(piece, left + 1))
            size += len(parts[-1])
            left -= len(parts[-1])
            check_content_size(name, size, f"the decompressed content of the {compression} file")
            if left < 0:
                raise InputError(
                    f"{name}: {len(raw)} bytes of {compression} hold more than "
                    f"{most // 2**20} MiB, as no log does: decompress the file first if it is right"
                )
            if not stream.eof:
                continue
            # Another member may follow, and so may padding with zeros (tapes): both are legal.
            position -= len(stream.unused_data)
            while position < len(raw) and raw[position] == 0:
                position += 1
            if position == len(raw):
                return b"".join(parts), None
            if not raw.startswith(magic, position):
                return b"".join(parts), f"bytes that are not {compression} follow the data"
            stream = new_stream()
    except (OSError, EOFError, zlib.error):
        return b"".join(parts), f"corrupt {compression} file"
    return b"".join(parts), f"truncated {compression} file"
