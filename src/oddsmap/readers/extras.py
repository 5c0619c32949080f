# SPDX-License-Identifier: Apache-2.0
"""Packages that only some formats need: a missing one is one line that says what to install."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from oddsmap.errors import InputError

__all__ = ["needs_extra"]


@contextmanager
def needs_extra(path: str, extra: str) -> Iterator[None]:
    """Say which extra to install where an import fails.

    Args:
        path: the file that needs it.
        extra: its name in pyproject.toml.

    Raises:
        InputError: in place of an ImportError.
    """
    try:
        yield
    except ImportError as error:
        missing = (error.name or "a package").split(".")[0]
        raise InputError(
            f'{path}: {missing} reads such files: pip install "oddsmap[{extra}]"'
        ) from None
