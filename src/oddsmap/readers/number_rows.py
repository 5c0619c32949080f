# SPDX-License-Identifier: Apache-2.0
"""Tables of numbers as people write them: blanks, commas or semicolons, comments, a header.

A comma is a separator where no blank stands within a field, and the decimal point of a number
where blanks or semicolons separate: then the table is refused.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass

from oddsmap.errors import InputError
from oddsmap.readers.compression import open_source
from oddsmap.readers.plain_text import decode_text, is_number, split_lines
from oddsmap.readers.text_table import Row

__all__ = ["NumberTable", "read_number_rows"]

_COMMENT = re.compile(r"#|//|%")
_NAME = re.compile(r"[._/]{0,2}[^\W\d_]")
_QUOTED = re.compile(r'"([^"]*)"')


@dataclass(frozen=True, slots=True)
class NumberTable:
    """Rows of words, and the names of their columns as far as the text has some.

    Args:
        rows: the rows; their words are meant to be numbers.
        headers: lines before the first row that may name the columns, split into words.
    """

    rows: list[Row]
    headers: list[list[str]]


def read_number_rows(path: str | os.PathLike[str]) -> NumberTable:
    """Read a table of numbers.

    Raises:
        InputError: the file cannot be read, or has decimal commas.
    """
    name = os.fspath(path)
    rows: list[Row] = []
    headers: list[list[str]] = []
    text = decode_text(name, open_source(path).content)
    if text.lstrip()[:1] == "<":
        raise InputError(
            f"{name}: XML, not a table of numbers"
            + (
                "; a track of GPS does not say where a sensor looks"
                if "<gpx" in text[:2000]
                else ""
            )
            + ": give poses in metres as text (t x y z qx qy qz qw)"
        )
    for number, line in enumerate(split_lines(text), start=1):
        where = f"{name}:{number}"
        before, *after = _COMMENT.split(line, maxsplit=1)
        if before.strip():
            if not rows and _is_header(_names(before)):
                headers.append(_names(before))
            else:
                rows.append(Row(where, _fields(where, before)))
        elif after and not rows:
            headers.append(_names(after[0]))
    return NumberTable(rows, headers)


def _fields(where: str, text: str) -> list[str]:
    """The words of a row, whatever separates them."""
    if ";" not in text and "," not in text:
        return text.split()
    text = _QUOTED.sub(_unquoted, text)
    separator = ";" if ";" in text else ","
    fields = [field.strip() for field in text.split(separator)]
    if not fields[-1]:  # a separator at the end of the line
        fields.pop()
    if "," in "".join(fields) or any(_several_numbers(field) for field in fields):
        raise InputError(
            f"{where}: {text.strip()[:40]!r} has commas within numbers, or mixed separators: "
            "write numbers with a decimal point, separated by blanks"
        )
    return fields


def _several_numbers(field: str) -> bool:
    words = field.split()
    return len(words) > 1 and any(map(is_number, words))


def _unquoted(found: re.Match[str]) -> str:
    """What stands in quotes, where it is one word: covariances of exported messages are not."""
    return found[1] if re.fullmatch(r"[^,;\s]*", found[1]) else "text"


def _is_header(words: list[str]) -> bool:
    """Whether words are names: a row of `None` or `--` is a bad row, and must not be left out."""
    if words[:1] == [""]:  # the index that pandas writes has no name
        words = words[1:]
    named = bool(words) and all(_NAME.match(word) and not is_number(word) for word in words)
    return named and len(set(words)) == len(words)


def _names(text: str) -> list[str]:
    """The names in a header, with their units: 'timestamp [ns],p_x [m]' has two."""
    separator = next((mark for mark in ";," if mark in text), None)
    if separator:
        return [name.strip().strip('"') for name in text.split(separator)]
    return re.sub(r"\s+(?=[\[(])", "", text).split()
