# SPDX-License-Identifier: Apache-2.0
"""Numbers as callers give them, before anything is compared with them."""

from __future__ import annotations

from numbers import Integral, Real

from oddsmap.errors import ConfigError

__all__ = ["check_numbers", "check_threads"]


def check_numbers(**given: object) -> None:
    """Refuse what is no single number; None is left to the caller.

    Raises:
        ConfigError: one is something else, such as a text or an array.
    """
    for name, value in given.items():
        if value is not None and not isinstance(value, Real):
            raise ConfigError(f"{name} is one number, got {value!r}")


def check_threads(threads: int) -> None:
    """Refuse what is no number of threads.

    Raises:
        ConfigError: it is no whole number of at least 1.
    """
    if not isinstance(threads, Integral):
        raise ConfigError(f"threads are a whole number, got {threads!r}")
    if threads < 1:
        raise ConfigError(f"threads are at least 1, got {threads}")
