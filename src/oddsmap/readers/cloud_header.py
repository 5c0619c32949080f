# SPDX-License-Identifier: Apache-2.0
"""Headers of point clouds: lines of text, and the numbers in them, before a body of any bytes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from oddsmap.readers.compression import Source
from oddsmap.readers.plain_text import refuse_utf16

__all__ = ["MAX_DIGITS", "HeaderLine", "header_lines", "is_count"]

MAX_DIGITS = 18
"""No count of a header has more: it would not fit 64 bits, and Python refuses to read thousands."""


class HeaderLine(NamedTuple):
    """A line of a header."""

    number: int
    """Its number in the file, from 1."""
    words: list[str]
    end: int
    """The first byte after it."""


def header_lines(source: Source) -> Iterator[HeaderLine]:
    """The lines of a file, for as long as the caller takes them for its header.

    They end with LF or CR LF; or with CR alone, as on old Macs, where the first one does.

    Raises:
        InputError: the file is a text in UTF-16.
    """
    content = source.content
    refuse_utf16(source.path, content)
    first_cr = content.find(b"\r")
    first_lf = content.find(b"\n")
    alone = first_cr >= 0 and not 0 <= first_lf <= first_cr + 1
    line_end = b"\r" if alone else b"\n"
    start, number = 0, 1
    while (end := content.find(line_end, start)) >= 0:
        words = content[start:end].decode("ascii", "replace").split()
        yield HeaderLine(number, words, end + 1)
        start, number = end + 1, number + 1


def is_count(word: str) -> bool:
    """Whether a word is a whole number of a size that a file can have."""
    return word.isdecimal() and len(word) <= MAX_DIGITS
