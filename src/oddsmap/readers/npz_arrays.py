# SPDX-License-Identifier: Apache-2.0
"""The arrays of an NPZ file: which there are, and those that a layout knows."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Collection
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.readers.compression import Source

__all__ = ["array_names", "load_arrays"]


def array_names(content: bytes) -> set[str]:
    """Names of the arrays in an NPZ file; none where its index is damaged.

    The index is at the end of the file: no start of it would do, since the first array may be
    large.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as file:
            return {name.removesuffix(".npy") for name in file.namelist()}
    except zipfile.BadZipFile:
        return set()


def load_arrays(source: Source, keys: Collection[str], main: str, write: str) -> dict[str, Any]:
    """Load the arrays that a layout knows; the others are not even decompressed.

    Args:
        source: the content of the file.
        keys: their names.
        main: the one that must be there.
        write: what to write as that one, for the message.

    Returns:
        Those of `keys` that are in the file.

    Raises:
        InputError: a corrupt file, an array of objects, or no `main`.
    """
    try:
        with np.load(io.BytesIO(source.content), allow_pickle=False) as file:
            found = sorted(file.files)
            arrays: dict[str, npt.NDArray[Any]] = {
                key: np.asarray(file[key]) for key in keys if key in found
            }
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, KeyError, NotImplementedError) as e:
        raise InputError(
            f"{source.path}: corrupt or truncated NPZ file ({e}): copy or write it again"
        ) from None
    except ValueError as e:  # NumPy's word for both a pickle and a damaged array header
        raise InputError(
            f"{source.path}: an array in the NPZ file cannot be read ({e}): "
            "write plain arrays of numbers"
        ) from None
    if main not in arrays:
        raise InputError(
            f"{source.path}: no array `{main}` in the NPZ file, found {', '.join(found)}: {write}"
        )
    return arrays
