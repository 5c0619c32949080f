# SPDX-License-Identifier: Apache-2.0
"""Onto the disk: what is renamed into place must not come up empty after a power cut."""

from __future__ import annotations

import errno
import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

__all__ = ["sync_folder", "sync_tree"]

# A disk writes what several wait for at the same time in one go.
_AT_ONCE = 8
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
    folders, files = [], []
    for folder, _, names in os.walk(path):
        folders.append(Path(folder))
        files += [Path(folder, name) for name in names]
    pool = ThreadPoolExecutor(_AT_ONCE)
    try:
        for sync, paths in ((_sync_file, files), (sync_folder, folders)):
            for waiting in [pool.submit(sync, path) for path in paths]:
                waiting.result()
    finally:
        pool.shutdown(cancel_futures=True)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk, where a folder can be waited for."""
    with suppress(OSError):  # Windows opens no folders
        _sync(folder, os.O_RDONLY)


def _sync_file(path: Path) -> None:
    if path.lstat().st_nlink > 1:
        return  # a link to what lay elsewhere before, and was waited for when it was written
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
