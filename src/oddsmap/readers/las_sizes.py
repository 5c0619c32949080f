# SPDX-License-Identifier: Apache-2.0
"""Sizes and counts in a LAS or LAZ file, checked before its decoder believes them.

Records are read for as long as a header says. The decoder of LAZ takes the number of chunks, and
the size of each layer of a chunk, as they stand in the file: in a damaged one that ends the
process. A chunk starts with its first point as it is; from point format 6 on its number of points
follows, and the size of each layer.

Source: Isenburg, LASzip (2013) and LASzip for LAS 1.4; the LAZ specification 1.4 of rapidlasso.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import BinaryIO

from oddsmap.errors import InputError

__all__ = ["check_sizes"]

_HEAD = 255  # that of version 1.4 up to its counts
_COMPRESSED = 0x80
_LASZIP = b"laszip encoded"
_RECORD_HEAD, _EXTENDED_HEAD = 54, 60
# How many layers an item has, by its type: a point of formats 6 on, RGB, RGB and infrared, and a
# wave packet. Of extra bytes each is one.
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_EXTRA_BYTES = 14


def check_sizes(path: str) -> None:
    """Raise InputError where what a LAS or LAZ file announces would not fit in it."""
    with Path(path).open("rb") as file:
        try:
            _check(file, os.fstat(file.fileno()).st_size)
        except (struct.error, ValueError) as error:
            raise InputError(
                f"{path}: the LAS file cannot be read ({error}): copy or write it again"
            ) from None


def _check(file: BinaryIO, size: int) -> None:
    head = file.read(_HEAD)
    head_size, points_at, records = struct.unpack_from("<HII", head, 94)
    form, length = struct.unpack_from("<BH", head, 104)
    if not head_size <= points_at <= size or records * _RECORD_HEAD > points_at - head_size:
        raise ValueError(f"its header announces {records} records, which would not fit in it")
    minor = head[25]
    if minor >= 4:
        at, extended = struct.unpack_from("<QI", head, 235)
        if extended and (at > size or extended * _EXTENDED_HEAD > size - at):
            raise ValueError(f"its header announces {extended} records behind its points")
    if not form & _COMPRESSED:
        held = (size - points_at) // max(1, length)
        if _point_count(head) > held:
            raise ValueError(f"it announces {_point_count(head)} points and holds {held}")
        return
    items = _items(file, head_size, records, points_at)
    if items is None:
        raise ValueError("it is compressed, and its LASzip record is missing")
    table_at, count = _table(file, size, points_at)
    if not points_at + 8 <= table_at <= size - 8:
        raise ValueError("its chunk table is beyond its end")
    if count * max(1, length) > table_at - points_at:
        raise ValueError(f"it announces {count} chunks, which would not fit in it")
    layers = [width if kind == _EXTRA_BYTES else _LAYERS.get(kind, 0) for kind, width in items]
    if any(kind in _LAYERS for kind, _ in items):
        points = _walk(file, points_at + 8, table_at, count, length, sum(layers))
        if points != _point_count(head):
            raise ValueError(
                f"the header announces {_point_count(head)} points, its chunks {points}"
            )


def _point_count(head: bytes) -> int:
    """How many points a header announces: from version 1.4 on in 64 bits."""
    minor = head[25]
    return int(
        struct.unpack_from("<Q", head, 247)[0]
        if minor >= 4
        else struct.unpack_from("<I", head, 107)[0]
    )


def _items(file: BinaryIO, start: int, records: int, end: int) -> list[tuple[int, int]] | None:
    """Type and size of the items of a point, by the record of LASzip."""
    at = start
    for _ in range(min(records, 10_000)):
        if at + _RECORD_HEAD > end:
            return None
        file.seek(at)
        name, number, length = struct.unpack_from("<16sHH", file.read(_RECORD_HEAD), 2)
        if name.rstrip(b"\0") == _LASZIP and number == 22204:
            record = file.read(length)
            (count,) = struct.unpack_from("<H", record, 32)
            items = [struct.unpack_from("<HHH", record, 34 + 6 * i) for i in range(count)]
            return [(kind, width) for kind, width, _ in items]
        at += _RECORD_HEAD + length
    return None


def _table(file: BinaryIO, size: int, points_at: int) -> tuple[int, int]:
    """Where the table of chunks is, and how many there are."""
    file.seek(points_at)
    (at,) = struct.unpack("<q", file.read(8))
    if at == -1:  # written to a stream: it stands at the end
        file.seek(max(0, size - 8))
        (at,) = struct.unpack("<q", file.read(8))
    if not 0 <= at <= size:
        raise ValueError("its chunk table is beyond its end")
    file.seek(at)
    _, count = struct.unpack("<II", file.read(8))
    return at, count


def _walk(file: BinaryIO, at: int, end: int, chunks: int, length: int, layers: int) -> int:
    """From chunk to chunk by the sizes of their layers; returns how many points they announce."""
    points = 0
    for number in range(chunks):
        if at + length + 4 * (layers + 1) > end:
            raise ValueError(f"chunk {number + 1} of {chunks} is beyond its end")
        file.seek(at + length)
        found, *sizes = struct.unpack(f"<{layers + 1}I", file.read(4 * (layers + 1)))
        points += found
        at += length + 4 * (layers + 1) + sum(sizes)
        if at > end:
            raise ValueError(f"chunk {number + 1} of {chunks} is beyond its end")
    return points
