# SPDX-License-Identifier: Apache-2.0
"""Rows of a damaged SQLite file, from its pages: SQLite itself stops at the first that is missing.

A table is a tree of pages. Its rows are on the leaves; a long row goes on on a chain of pages. The
leaves of messages are known by what is on them, so that they are found without the tree, too.

Source: https://www.sqlite.org/fileformat2.html
"""

from __future__ import annotations

import os
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["SqlitePages"]

_LEAF, _INNER = 0x0D, 0x05
# Tables of topics and types take some pages; a tree of more than that, all below each other, would
# be too deep to follow.
_MOST_PAGES = 500


class _DamagedRowError(Exception):
    """A row that is not whole."""


class SqlitePages:
    """A file of SQLite as pages.

    Args:
        path: the file.

    Raises:
        OSError: it cannot be read.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        with Path(path).open("rb") as file:
            head = file.read(100).ljust(100, b"\0")
            size = os.fstat(file.fileno()).st_size
        stated = int.from_bytes(head[16:18], "big")
        self._page = 65536 if stated == 1 else stated
        usable = self._page >= 512 and self._page & (self._page - 1) == 0
        if not usable:
            self._page = 4096
        self._used = self._page - head[20]
        self._size = size
        # The last one may be cut: what stands before the cut is read.
        self._count = -(-size // self._page)
        # The number of pages holds where the last program that wrote it knew of that field.
        known = usable and head[24:28] == head[92:96]
        pages = int.from_bytes(head[28:32], "big") if known else 0
        self.missing = max(0, pages * self._page - size)
        """How many bytes are missing at the end."""

    def messages(self, *, contents: bool = True) -> Iterator[tuple[int, int, int, bytes]]:
        """All messages that are whole: number, topic, time of writing [ns], and content.

        Args:
            contents: read them; else they are empty, but still known to be there.
        """
        with Path(self._path).open("rb") as file:
            rows, pages, cells = array("q"), array("q"), array("q")
            for number in range(1, self._count + 1):
                page = self._read(file, number)
                if page[:1] != bytes([_LEAF]):
                    continue
                for cell in _cells(page):
                    try:
                        row, values = self._row(file, page, cell, whole=False)
                    except _DamagedRowError:
                        continue
                    if _is_message(values):
                        rows.append(row)
                        pages.append(number)
                        cells.append(cell)
            # By their numbers, which is the order of writing. Of a page that was used again there
            # may be two copies.
            _, order = np.unique(np.array(rows, np.int64), return_index=True)
            for at in order.tolist():
                page, cell = self._read(file, pages[at]), cells[at]
                try:
                    row, values = self._row(file, page, cell, whole=contents)
                    if not contents:
                        self._check_chain(file, page, cell)
                except _DamagedRowError:
                    continue
                yield row, values[1], values[2], values[3] if contents else b""

    def table(self, name: str) -> list[list[Any]]:
        """The rows of a small table; the number of a row in place of a NULL at its start."""
        with Path(self._path).open("rb") as file:
            for row in self._tree(file, 1, set()):
                if len(row) > 3 and row[:2] == ["table", name] and isinstance(row[3], int):
                    return list(self._tree(file, row[3], set()))
        return []

    def _tree(self, file: Any, number: int, seen: set[int]) -> Iterator[list[Any]]:
        if number in seen or len(seen) > _MOST_PAGES:
            return
        seen.add(number)
        page = self._read(file, number)
        start = 100 if number == 1 else 0
        kind = page[start : start + 1]
        if kind == bytes([_LEAF]):
            for cell in _cells(page, start):
                try:
                    row, values = self._row(file, page, cell, whole=True)
                except _DamagedRowError:
                    continue
                if values and values[0] is None:
                    values[0] = row
                yield values
        elif kind == bytes([_INNER]):
            children = [
                int.from_bytes(page[cell : cell + 4], "big") for cell in _cells(page, start)
            ]
            children.append(int.from_bytes(page[start + 8 : start + 12], "big"))
            for child in children:
                yield from self._tree(file, child, seen)

    def _read(self, file: Any, number: int) -> bytes:
        if not 1 <= number <= self._count:
            return b""
        file.seek((number - 1) * self._page)
        content: bytes = file.read(self._page)
        return content

    def _row(self, file: Any, page: bytes, cell: int, *, whole: bool) -> tuple[int, list[Any]]:
        """The number of a row and its values; without `whole`, those of the first page.

        Raises:
            _DamagedRowError: it is none.
        """
        size, place = _varint(page, cell)
        row, place = _varint(page, place)
        here = self._here(size)
        content = page[place : place + here]
        if len(content) < here:
            raise _DamagedRowError
        if whole and here < size:
            content += self._chain(file, page[place + here : place + here + 4], size - here)
        return row, _values(content, size)

    def _here(self, size: int) -> int:
        """How much of a row stands on the leaf itself."""
        most = self._used - 35
        if size <= most:
            return size
        least = (self._used - 12) * 32 // 255 - 23
        kept = least + (size - least) % (self._used - 4)
        return kept if kept <= most else least

    def _chain(self, file: Any, first: bytes, size: int) -> bytes:
        """What stands on the chain of pages of a long row."""
        if size > self._count * self._page:
            raise _DamagedRowError
        parts, number = [], int.from_bytes(first, "big")
        while size > 0:
            page = self._read(file, number)
            length = min(size, self._used - 4)
            if len(page) < 4 + length:
                raise _DamagedRowError
            parts.append(page[4 : 4 + length])
            size -= length
            number = int.from_bytes(page[:4], "big")
        return b"".join(parts)

    def _check_chain(self, file: Any, page: bytes, cell: int) -> None:
        size, place = _varint(page, cell)
        _, place = _varint(page, place)
        here = self._here(size)
        left, number = size - here, int.from_bytes(page[place + here : place + here + 4], "big")
        if left > self._count * self._page:
            raise _DamagedRowError
        while left > 0:
            if not 1 <= number <= self._count:
                raise _DamagedRowError
            place = (number - 1) * self._page
            if place + 4 + min(left, self._used - 4) > self._size:
                raise _DamagedRowError
            file.seek(place)
            number = int.from_bytes(file.read(4), "big")
            left -= self._used - 4


def _is_message(values: list[Any]) -> bool:
    """Whether a row is one of messages: its number, a topic, a time and bytes."""
    return (
        len(values) == 4
        and values[0] is None
        and all(isinstance(value, int) for value in values[1:3])
        and isinstance(values[3], bytes)
    )


def _cells(page: bytes, start: int = 0) -> list[int]:
    """Where the cells of a page are."""
    inner = page[start : start + 1] == bytes([_INNER])
    count = int.from_bytes(page[start + 3 : start + 5], "big")
    begin = start + (12 if inner else 8)
    count = min(count, (len(page) - begin) // 2)
    return [int.from_bytes(page[p : p + 2], "big") for p in range(begin, begin + 2 * count, 2)]


def _varint(content: bytes, place: int) -> tuple[int, int]:
    value = 0
    for step in range(9):
        if place >= len(content):
            raise _DamagedRowError
        byte = content[place]
        place += 1
        if step == 8:
            return (value << 8) | byte, place
        value = (value << 7) | (byte & 0x7F)
        if byte < 0x80:
            break
    return value, place


_SIZES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8, 7: 8}


def _values(content: bytes, size: int) -> list[Any]:
    """The values of a row; bytes and texts may go on beyond the content."""
    length, place = _varint(content, 0)
    if not place <= length <= len(content):
        raise _DamagedRowError
    kinds = []
    while place < length:
        kind, place = _varint(content, place)
        kinds.append(kind)
    values: list[Any] = []
    for kind in kinds:
        wide = (kind - 12) // 2 if kind >= 12 else _SIZES.get(kind, 0)
        if place + wide > size:
            raise _DamagedRowError
        part = content[place : place + wide]
        place += wide
        if kind == 0:
            values.append(None)
        elif kind in (8, 9):
            values.append(kind - 8)
        elif kind < 7:
            values.append(int.from_bytes(part, "big", signed=True))
        elif kind >= 12 and kind % 2 == 0:
            values.append(part)
        else:
            values.append(part.decode("utf-8", "replace"))
    return values
