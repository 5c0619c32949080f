# SPDX-License-Identifier: Apache-2.0
"""Renaming into place: in one step where the system can, else in two that can be made good.

A file takes the place of a file in one step everywhere. A folder that holds anything cannot be
replaced by POSIX's rename: Linux exchanges the two (renameat2), other systems have the old one step
aside first.
"""

from __future__ import annotations

import errno
import os
import shutil
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

__all__ = ["put_in_place", "remove", "rename_to_free"]

_HERE = -100  # AT_FDCWD: paths as they are
_NO_REPLACE, _EXCHANGE = 1, 2
# Of a kernel, a C library or a file system without that kind of renaming.
_CANNOT = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP}
# Others may write to the same place: each time one was quicker, once more.
_TRIES = 100


def put_in_place(new: Path, path: Path, aside: Path, *, force: bool) -> None:
    """Rename a file or folder to its place; what was there is at `new` or `aside` afterwards.

    Args:
        new: what was made.
        path: its place.
        aside: where an old folder goes for a moment, if it has to; removed if it exists.
        force: True if what is there may be replaced.

    Raises:
        FileExistsError: there is something, and `force` is False.
        OSError: it cannot be renamed.
    """
    if force and not new.is_dir():
        new.replace(path)
        return
    for _ in range(_TRIES):
        try:
            rename_to_free(new, path)
            return
        except FileExistsError:
            if not force:
                raise
        try:
            if _rename(new, path, _EXCHANGE):
                return
            remove(aside)
            path.rename(aside)
        except FileNotFoundError:  # gone meanwhile: the place is free
            if not new.exists():
                raise
    raise OSError(errno.EBUSY, "others keep writing to the same place")


def rename_to_free(source: Path, path: Path) -> None:
    """Rename a file or folder to a place where there is nothing.

    Raises:
        FileExistsError: there is something.
        OSError: it cannot be renamed.
    """
    if _rename(source, path, _NO_REPLACE):
        return
    if os.path.lexists(path):
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
    try:
        source.rename(path)
    except OSError as error:  # a folder that came meanwhile
        if error.errno == errno.ENOTEMPTY:
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        raise


def remove(path: Path) -> None:
    """Remove a file, a link or a folder with all in it, as far as that is possible."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink(missing_ok=True)


@cache
def _renameat2() -> Any:
    if sys.platform != "linux":
        return None
    import ctypes

    try:
        call = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return None
    call.argtypes = [
        ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_uint,
    ]  # fmt: skip
    call.restype = ctypes.c_int
    return call


def _rename(source: Path, path: Path, flag: int) -> bool:
    """Whether the system could do it; OSError where it could and it went wrong."""
    call = _renameat2()
    if call is None:
        return False
    import ctypes

    if call(_HERE, os.fsencode(source), _HERE, os.fsencode(path), flag) == 0:
        return True
    number = ctypes.get_errno()
    if number in _CANNOT:
        return False
    raise OSError(number, os.strerror(number), str(path))
