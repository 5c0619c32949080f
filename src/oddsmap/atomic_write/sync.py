# SPDX-License-Identifier: Apache-2.0
"""Onto the disk: what is renamed into place must not come up empty after a power cut."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path

__all__ = ["sync_folder", "sync_tree"]

# Answers of file systems that have nothing to wait for.
_NOTHING_TO_DO = {errno.EINVAL, errno.ENOTSUP, errno.ENOSYS, errno.EROFS}


def sync_tree(path: Path) -> None:
    """Wait until a file, or a folder with all that it holds, is on the disk.

    Raises:
        OSError: the disk did not take it.
    """
    if path.is_symlink() or not path.is_dir():
        _sync_file(path)
        return
    for folder, _, names in os.walk(path):
        for name in names:
            _sync_file(Path(folder, name))
        sync_folder(Path(folder))


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk, where a folder can be waited for."""
    with suppress(OSError):  # Windows opens no folders
        _sync(folder, os.O_RDONLY)


def _sync_file(path: Path) -> None:
    _sync(path, os.O_RDWR)  # Windows syncs only what is open for writing


def _sync(path: Path, flags: int) -> None:
    number = os.open(path, flags | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0))
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno not in _NOTHING_TO_DO:
            raise
    finally:
        os.close(number)
