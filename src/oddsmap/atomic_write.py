# SPDX-License-Identifier: Apache-2.0
"""Writing that leaves the old file, the new file or none, never a half.

Everything is written to a hidden sibling first and renamed at the end. A folder cannot be
replaced in one step, so the old one steps aside, and comes back should the second step fail.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from oddsmap.errors import OutputError

__all__ = ["atomic_output", "check_output"]


def check_output(path: Path, *, force: bool = False) -> None:
    """Refuse an output before any work is done for it.

    Args:
        path: the file or folder to be written.
        force: True where an existing one may be replaced.

    Raises:
        OutputError: it exists and `force` is False, it is a folder of other things than a map,
            or its folder is missing or not writable.
    """
    if not path.name:
        raise OutputError(f"{path}: is a folder; give the name of what to write in it")
    if path.exists() and not force:
        raise OutputError(f"{path}: exists already; use --force (force=True) to replace it")
    # Replacing deletes: that is for maps (Zarr), never for what else a person keeps in a folder.
    is_map = path.suffix == ".zarr" or (path / "zarr.json").is_file()
    if path.is_dir() and not is_map and any(path.iterdir()):
        raise OutputError(f"{path}: is a folder and no map, it is not replaced; give another name")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise OutputError(f"{path}: the folder {folder} does not exist; create it first")
    if not os.access(folder, os.W_OK):
        raise OutputError(f"{path}: the folder {folder} cannot be written to")


@contextmanager
def atomic_output(path: Path, *, force: bool = False) -> Iterator[Path]:
    """Give a temporary sibling to write to; put it in the place of `path` at the end.

    Args:
        path: the file or folder to be written.
        force: True where an existing one may be replaced.

    Yields:
        The path to write to (it does not exist yet), with the same suffix as `path`.

    Raises:
        OutputError: see `check_output`; also where writing fails.
    """
    check_output(path, force=force)
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield part
        _put_in_place(part, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        _remove(part)


def _put_in_place(part: Path, path: Path) -> None:
    if not path.is_dir():
        part.replace(path)
        return
    aside = path.with_name(f".{path.stem}.{os.getpid()}.old{path.suffix}")
    path.rename(aside)
    try:
        part.rename(path)
    except OSError:
        aside.rename(path)
        raise
    _remove(aside)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
