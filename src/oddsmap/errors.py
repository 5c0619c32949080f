# SPDX-License-Identifier: Apache-2.0
"""The errors that oddsmap raises on purpose.

Each message is one line: what went wrong, where, what was found, what to do.
"""

from __future__ import annotations

from collections.abc import Iterable

__all__ = [
    "ConfigError",
    "InputError",
    "MapTooLargeError",
    "OddsmapError",
    "OutputError",
    "RecoveryWarning",
    "did_you_mean",
]


class OddsmapError(Exception):
    """Root of all errors raised on purpose; the command line turns it into exit status 1."""


class InputError(OddsmapError, ValueError):
    """A file, array or reading that cannot be used."""


class ConfigError(OddsmapError, ValueError):
    """A parameter outside its range, or a configuration key that does not exist."""


class OutputError(OddsmapError):
    """A file that exists already or cannot be written."""


class MapTooLargeError(OddsmapError, MemoryError):
    """A map, or the window of one scan, that would not fit in memory."""


class RecoveryWarning(UserWarning):
    """What a killed run had left was put back, finished or removed."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A question for messages: `did you mean "a" or "b"? `; empty where nothing is near.

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
    return f"did you mean {' or '.join(near)}? "
