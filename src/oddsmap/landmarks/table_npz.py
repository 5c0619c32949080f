# SPDX-License-Identifier: Apache-2.0
"""Columns of observations from an NPZ file: one array of shape (n,) per column."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError, shown
from oddsmap.readers.compression import Source
from oddsmap.readers.npz_arrays import load_found_arrays

__all__ = ["NO_ID", "check_id", "is_npz", "read_npz_columns"]

NO_ID = -1


def is_npz(head: bytes) -> bool:
    """Whether a file that starts like this is a zip archive, as an NPZ is."""
    return head.startswith(b"PK\x03\x04")


def read_npz_columns(
    source: Source, known: Collection[str]
) -> tuple[dict[str, npt.NDArray[np.float64]], npt.NDArray[np.int64] | None, list[str]]:
    """Read the columns that have a meaning; the others are ignored.

    Args:
        source: the content.
        known: names of the columns that are read.

    Returns:
        The columns other than `id`, each of shape (n,); the ids, `NO_ID` for a NaN, or None where
        there is no column `id`; where each row stands, for messages.

    Raises:
        InputError: a corrupt file, an array of another shape or type, or an id that is not an
            integer.
    """
    path = source.path
    arrays = load_found_arrays(source, known)
    count = max((array.size for array in arrays.values()), default=0)
    for name, array in arrays.items():
        if array.shape != (count,) or array.dtype.kind not in "iuf":
            raise InputError(
                f"{path}: `{name}` holds {array.dtype} of shape {array.shape}: columns are arrays "
                f"of numbers of one shape, here ({count},)"
            )
    places = [f"{path}: row {row}" for row in range(count)]
    named = arrays.pop("id", None)
    ids = None
    if named is not None:
        names = [
            NO_ID if i != i else check_id(w, i) for w, i in zip(places, named.tolist(), strict=True)
        ]
        ids = np.array(names, dtype=np.int64)
    return {name: array.astype(np.float64) for name, array in arrays.items()}, ids, places


def check_id(where: str, number: float) -> int:
    """A number as the name of a landmark; a negative one is none.

    Raises:
        InputError: not an integer, or one of more than 64 bits.
    """
    if not (abs(number) < 2**63 and number % 1 == 0):
        raise InputError(f"{where}: the id {shown(number)} is not an integer of 64 bits")
    return int(number) if number >= 0 else NO_ID
