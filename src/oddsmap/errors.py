# SPDX-License-Identifier: Apache-2.0
"""The errors that oddsmap raises on purpose.

Each message is one line: what went wrong, where, what was found, what to do.
"""

__all__ = [
    "ConfigError",
    "InputError",
    "MapTooLargeError",
    "OddsmapError",
    "OutputError",
    "RecoveryWarning",
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
