# SPDX-License-Identifier: Apache-2.0
"""Texts as programs write them: byte order marks, line ends, and the many spellings of NaN."""

from __future__ import annotations

import math
import re

from oddsmap.errors import InputError
from oddsmap.readers.compression import Source

__all__ = ["decode_text", "is_number", "refuse_utf16", "split_lines", "to_number", "without_bom"]

_BOM = b"\xef\xbb\xbf"
_UTF16 = (b"\xff\xfe", b"\xfe\xff")

# What C libraries print beside nan and inf: glibc and MSVC put a kind in brackets, older MSVC
# prints 1.#QNAN or -1.#IND, cut or filled with zeros to the precision asked for.
_ODD_NAN = re.compile(r"[+-]?(nan\([^()]*\)|1\.#(q?nan|snan|ind)0*)", re.IGNORECASE)
_ODD_INFINITY = re.compile(r"([+-]?)1\.#inf0*", re.IGNORECASE)


def refuse_utf16(path: str, head: bytes) -> None:
    """Raise InputError where a file starts as a text in UTF-16, which some Windows programs write.

    Args:
        path: what the message starts with.
        head: the first bytes of the file.
    """
    if head.startswith(_UTF16):
        raise InputError(f"{path}: the text is UTF-16: save it as UTF-8 or plain ASCII")


def without_bom(source: Source) -> Source:
    """The file without the mark that some editors put before a text in UTF-8."""
    if not source.content.startswith(_BOM):
        return source
    return Source(source.path, source.content[len(_BOM) :], source.damage)


def decode_text(path: str, content: bytes) -> str:
    """A text without its byte order mark.

    Raises:
        InputError: it is UTF-16.
    """
    refuse_utf16(path, content)
    return content.decode("utf-8-sig", "replace")


def split_lines(text: str) -> list[str]:
    """The lines of a text, whether they end with LF, CR LF or, as on old Macs, CR alone."""
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def to_number(word: str) -> float:
    """A word as a number, NaN and infinities included.

    Raises:
        ValueError: it is none.
    """
    # 1_0 is 10 to Python and to nobody else, and so are the digits of other scripts.
    if "_" in word or not word.isascii():
        raise ValueError
    try:
        return float(word)
    except ValueError:
        if _ODD_NAN.fullmatch(word):
            return math.nan
        if infinite := _ODD_INFINITY.fullmatch(word):
            return -math.inf if infinite[1] == "-" else math.inf
        raise


def is_number(word: str) -> bool:
    """Whether `to_number` takes a word."""
    try:
        to_number(word)
    except ValueError:
        return False
    return True
