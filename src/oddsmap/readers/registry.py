# SPDX-License-Identifier: Apache-2.0
"""Which reader reads a file: chosen by its content, never by its suffix."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

from oddsmap.errors import InputError
from oddsmap.readers import carmen, npz_beams
from oddsmap.readers.container import Source, open_source
from oddsmap.scan import Log

__all__ = ["READERS", "Reader", "open_log"]


@dataclass(frozen=True, slots=True)
class Reader:
    """One format.

    Args:
        name: name of the format in the plural, for people.
        matches: whether the first 64 KiB of decompressed content are of this format.
        open: reads the whole content; raises InputError where no usable scan is in it.
    """

    name: str
    matches: Callable[[bytes], bool]
    open: Callable[[Source], Log]


# Asked in this order: formats with magic bytes first, texts after them.
READERS: tuple[Reader, ...] = (
    Reader("NPZ beam logs", npz_beams.matches, npz_beams.open_npz_beams),
    Reader("CARMEN logs", carmen.matches, carmen.open_carmen),
)


def open_log(path: str | os.PathLike[str], *, skip_bad: bool = False) -> Log:
    """Open a log of range readings with poses.

    The format is recognized by its content, under gzip or bzip2 as well. A bad line or reading is
    skipped and counted in the log's `skipped`, always.

    Args:
        path: the file.
        skip_bad: of a truncated or corrupt gzip or bzip2 file, use the readable part and count
            `container.truncated`.

    Returns:
        The scans in file order, and what had to be skipped to get them.

    Raises:
        InputError: the file cannot be read, is of no known format, or holds no usable scan.
    """
    source = open_source(path, skip_bad=skip_bad)
    for reader in READERS:
        if reader.matches(source.head):
            return reader.open(source)
    known = " and ".join(reader.name for reader in READERS)
    raise InputError(
        f"{source.path}: unknown file type (it starts with {source.content[:16]!r}): "
        f"oddsmap reads {known}, plain or compressed with gzip or bzip2"
    )
