# SPDX-License-Identifier: Apache-2.0
"""What an export has written."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

__all__ = ["Written"]


class Written(NamedTuple):
    """The files of an export, and what to know of them."""

    files: list[Path]
    notes: tuple[str, ...] = ()
