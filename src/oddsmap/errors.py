# SPDX-License-Identifier: Apache-2.0
"""The errors that oddsmap raises on purpose.

Each message is one line: what went wrong, where, what was found, what to do.
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterable
from typing import Self

__all__ = [
    "ConfigError",
    "InputError",
    "MapTooLargeError",
    "OddsmapError",
    "OutputError",
    "RecoveryWarning",
    "as_line",
    "did_you_mean",
    "shown",
]

# A message that quotes a damaged file may run to pages. Of a longer one than this the middle is
# left out: where it happened stands at its start, what to do at its end.
_LONGEST, _HEAD, _TAIL = 400, 240, 140


class OddsmapError(Exception):
    """Root of all errors raised on purpose; the command line turns it into exit status 1."""

    def __init__(self, message: object = "") -> None:
        super().__init__(as_line(str(message)))


class InputError(OddsmapError, ValueError):
    """A file, array or reading that cannot be used."""


class ConfigError(OddsmapError, ValueError):
    """A parameter outside its range, or a configuration key that does not exist."""


class OutputError(OddsmapError):
    """A file that exists already or cannot be written."""


class MapTooLargeError(OddsmapError, MemoryError):
    """A map, or the window of one scan, that would not fit in memory."""

    def __new__(cls, *args: object) -> Self:
        """As any other error of ours: pickles of Dask call this, and MemoryError's would refuse."""
        return Exception.__new__(cls, *args)


class RecoveryWarning(UserWarning):
    """What a killed run had left was put back, finished or removed."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A question for messages: `, did you mean "a" or "b"?`; empty where nothing is near.

    Args:
        name: what was said.
        known: what there is.
    """
    from difflib import SequenceMatcher

    likeness = {word: SequenceMatcher(None, name.lower(), word).ratio() for word in known}
    best = max(likeness.values(), default=0.0)
    if best < 0.5:
        return ""
    near = [f'"{word}"' for word, ratio in likeness.items() if ratio == best]
    return f", did you mean {' or '.join(near)}?"


def as_line(text: str, longest: int = _LONGEST) -> str:
    """A text as one printable line: control characters are escaped, a long middle is left out."""
    text = _cut(text, longest)
    if text.isprintable():
        return text
    escaped = (
        c if c.isprintable() else " " if c in "\r\n" else c.encode("unicode_escape").decode()
        for c in text
    )
    return _cut("".join(escaped), longest)  # again: an escape is longer than what it stands for


def _cut(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    head, tail = longest * _HEAD // _LONGEST, longest * _TAIL // _LONGEST
    return f"{text[:head]} ... {text[len(text) - tail :]}"


class _Shown(reprlib.Repr):
    """`repr` in bounded time and length, also of trees of aliases and of integers of pages."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother = 2, 40, 40
        self.maxlist = self.maxtuple = self.maxset = self.maxdict = 3

    def repr_int(self, x: int, level: int) -> str:
        """Digits of a small number, the order of magnitude of a large one."""
        if -(10**20) < x < 10**20:
            return str(x)
        return f"a whole number of about {int(x.bit_length() * 0.30103) + 1} digits"

    def repr_dict(self, x: dict[object, object], level: int) -> str:
        """The base class would sort all keys."""
        if level <= 0 or not x:
            return "{...}" if x else "{}"
        first = next(iter(x))
        pair = f"{self.repr1(first, level - 1)}: {self.repr1(x[first], level - 1)}"
        return f"{{{pair}, ...}}" if len(x) > 1 else f"{{{pair}}}"


_SHOWN = _Shown()


def shown(value: object) -> str:
    """A value from a file as a message quotes it: short, whatever it is."""
    return as_line(_SHOWN.repr(value), 100)
