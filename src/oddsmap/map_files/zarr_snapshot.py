# SPDX-License-Identifier: Apache-2.0
"""Reading a saved map that may be replaced meanwhile: one map or the other, never a mixture.

A save replaces the whole folder. Its `zarr.json` is looked at before and after: the save's id in it
is another for each save. A change, or whatever goes wrong at the same time, is a reason to begin
again.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from oddsmap.atomic_write import put_back
from oddsmap.errors import InputError, OddsmapError

__all__ = ["DAMAGE", "Mark", "holds", "mark_of", "read_unchanged", "settled"]

T = TypeVar("T")

# A map that is replaced in half the time that reading takes is read in the end in a million to one.
_TRIES = 100
_LONGEST_WAIT = 0.05
_WORDS = 200
DAMAGE = (
    OSError, LookupError, AttributeError, TypeError, ValueError, ArithmeticError, RuntimeError,
)  # fmt: skip
"""What Zarr and its codecs raise on damage."""
Mark = tuple[int, int, int, bytes]


def holds(path: str | os.PathLike[str], array: str) -> bool:
    """Whether a path looks like a saved map that has an array of this name."""
    folder = settled(Path(path))
    return (folder / "zarr.json").is_file() and (folder / array).is_dir()


def settled(path: Path) -> Path:
    """The same path, once what a killed run had set aside is back, or a run in between is done."""
    for attempt in range(_TRIES):
        if os.path.lexists(path) or not put_back(path):
            break
        time.sleep(_pause(attempt))
    return path


def read_unchanged(path: Path, read: Callable[[], T]) -> T:
    """Read a saved map, again where it has been replaced meanwhile.

    Args:
        path: the folder.
        read: reads it.

    Raises:
        InputError: it is damaged, or was replaced each time.
        OddsmapError: what `read` raises.
    """
    for attempt in range(_TRIES):
        before = mark_of(settled(path))
        try:
            found = read()
        except OddsmapError:
            if mark_of(path) == before:
                raise
        except DAMAGE as error:
            if mark_of(path) == before:
                raise InputError(
                    f"{path}: damaged, cannot be read as a map: {_one_line(error)}"
                ) from None
        else:
            if mark_of(path) == before:
                return found
        time.sleep(_pause(attempt))
    raise InputError(
        f"{path}: was replaced each of the {_TRIES} times that it was read: wait until what writes "
        "it has finished"
    )


def mark_of(path: Path) -> Mark | None:
    """What is another for each save of a map; None where there is no map."""
    file = path / "zarr.json"
    try:
        with file.open("rb") as content:
            facts = os.fstat(content.fileno())
            return facts.st_dev, facts.st_ino, facts.st_mtime_ns, content.read()
    except OSError:
        return None


def _pause(attempt: int) -> float:
    return min(1e-3 * attempt, _LONGEST_WAIT)


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= _WORDS else f"{text[:_WORDS]} ..."
