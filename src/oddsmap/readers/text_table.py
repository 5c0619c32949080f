# SPDX-License-Identifier: Apache-2.0
"""Numbers in text: rows of them, with the line they stand in."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, DecimalException

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.readers.compression import open_source
from oddsmap.readers.plain_text import decode_text, is_number, split_lines, to_number

__all__ = ["Row", "parse_numbers", "parse_stamp_ns", "parse_table", "read_rows"]

_MAX_STAMP_S = Decimal(2**63 - 1) / 10**9


@dataclass(frozen=True, slots=True)
class Row:
    """A line of text: where it stands ("poses.txt:7") and its words."""

    where: str
    words: list[str]


def read_rows(path: str | os.PathLike[str]) -> list[Row]:
    """The lines of a file that are neither empty nor comments (`#`).

    Raises:
        InputError: the file cannot be read.
    """
    name = os.fspath(path)
    text = decode_text(name, open_source(path).content)
    return [
        Row(f"{name}:{number}", words)
        for number, line in enumerate(split_lines(text), start=1)
        if (words := line.split()) and not words[0].startswith("#")
    ]


def parse_numbers(row: Row, words: Sequence[str]) -> list[float]:
    """Words of a row as finite numbers.

    Raises:
        InputError: one is not a number, or is NaN or infinite.
    """
    try:
        numbers = [to_number(word) for word in words]
    except ValueError:
        bad = next(word for word in words if not is_number(word))
        raise InputError(f"{row.where}: {bad[:40]!r} is not a number") from None
    for word, number in zip(words, numbers, strict=True):
        if not np.isfinite(number):
            raise InputError(
                f"{row.where}: {word[:40]!r} is not a finite number: take the row out, "
                "and the scan that belongs to it"
            )
    return numbers


def parse_stamp_ns(row: Row, word: str) -> int:
    """Seconds in decimal to integer nanoseconds.

    Raises:
        InputError: not a number, or too large for 64 bits (the year 2262).
    """
    # Decimal, because a float64 of seconds since 1970 is 200 ns coarse.
    try:
        if not is_number(word):
            raise ValueError
        seconds = Decimal(word)
    except (ValueError, DecimalException):
        raise InputError(f"{row.where}: {word[:40]!r} is not a time in seconds") from None
    # Compared before anything is computed: even abs(1e9999999) is an overflow of its own kind.
    if not seconds.is_finite() or not -_MAX_STAMP_S <= seconds <= _MAX_STAMP_S:
        raise InputError(
            f"{row.where}: {word[:40]!r} is not a time in seconds that fits 64 bits of nanoseconds"
        )
    return int((seconds * 10**9).to_integral_value())


def parse_table(
    path: str, lines: Sequence[str], numbers: Sequence[int], columns: int
) -> npt.NDArray[np.float64]:
    """Lines of equally many numbers as an array; NaN and infinite ones are let through.

    Args:
        path: what messages start with.
        lines: the lines, none of them empty.
        numbers: the number of each line in its file.
        columns: how many numbers each must have.

    Returns:
        The numbers, shape (len(lines), columns).

    Raises:
        InputError: a line has another count of numbers, or a word that is none.
    """
    if not lines:
        return np.empty((0, columns))
    try:
        table: npt.NDArray[np.float64] = np.loadtxt(lines, comments=None, ndmin=2)
    except ValueError:
        table = np.empty((0, 0))
    if table.shape == (len(lines), columns):
        return table
    # The slow way finds the line to blame.
    for number, line in zip(numbers, lines, strict=True):
        words = line.split()
        if len(words) != columns:
            raise InputError(
                f"{path}:{number}: {len(words)} values where the header announces {columns}: "
                "check how the file was written"
            )
        for word in words:
            if not is_number(word):
                raise InputError(f"{path}:{number}: {word[:40]!r} is not a number")
    return np.array([[to_number(word) for word in line.split()] for line in lines])
