# SPDX-License-Identifier: Apache-2.0
"""Outputs that replace old ones once they are complete, and on the disk."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from oddsmap.atomic_write.swap import put_in_place
from oddsmap.atomic_write.sync import sync_folder, sync_tree
from oddsmap.atomic_write.work_folder import WorkFolder, clear_dead
from oddsmap.errors import OutputError

__all__ = ["atomic_output", "atomic_outputs", "check_output", "why_no_file"]

Why = Callable[[Path], str | None]


def why_no_file(path: Path) -> str | None:
    """Why a file does not take the place of what is there, `force` or not; None: it may."""
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        return "is a folder, and a file is to be written"
    if not stat.S_ISREG(mode):
        return "is no file but a pipe, a socket or a device"
    return None


def check_output(path: Path, *, force: bool = False, why_not: Why = why_no_file) -> None:
    """Refuse an output before any work is done for it; clear what killed runs left beside it.

    Args:
        path: the file or folder to be written. A symbolic link is replaced itself, what it leads
            to is left alone.
        force: True where an existing one may be replaced.
        why_not: says why what is there is not replaced, `force` or not; None: it may be.

    Raises:
        OutputError: it exists and `force` is False, it may not be replaced, or its folder is
            missing or not writable.
    """
    if not path.name:
        raise OutputError(f"{path}: is a folder; give the name of what to write in it")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise OutputError(f"{path}: the folder {folder} does not exist; create it first")
    if os.access(folder, os.W_OK):
        clear_dead(folder)
    if os.path.lexists(path) and not force:
        raise OutputError(f"{path}: exists already; use force=True to replace it")
    _check_replaceable(path, why_not)
    if not os.access(folder, os.W_OK):
        raise OutputError(f"{path}: the folder {folder} cannot be written to")


def _check_replaceable(path: Path, why_not: Why) -> None:
    # Replacing deletes: that is for what is ours, never for what else a person keeps there.
    reason = None if path.is_symlink() or not path.exists() else why_not(path)
    if reason is not None:
        raise OutputError(f"{path}: {reason}: it is not replaced; give another name")


@contextmanager
def atomic_output(path: Path, *, force: bool = False, why_not: Why = why_no_file) -> Iterator[Path]:
    """Give a temporary path to write to; put it in the place of `path` at the end.

    What is written is on the disk before it takes its place. Several may write to one path at the
    same time: each leaves a whole output, and the last one stays.

    Args:
        path: the file or folder to be written.
        force: True where an existing one may be replaced.
        why_not: see `check_output`.

    Yields:
        The path to write to (it does not exist yet), with the name of `path`, in a hidden folder
        beside it.

    Raises:
        OutputError: see `check_output`; also where writing fails.
    """
    with atomic_outputs(path, force=force, why_not=why_not) as parts:
        yield parts[0]


@contextmanager
def atomic_outputs(
    *paths: Path, force: bool = False, why_not: Why = why_no_file
) -> Iterator[list[Path]]:
    """As `atomic_output`, for several files of one folder that belong together.

    Args:
        paths: the files to be written, in the order in which they are put in place. A run that is
            killed in between is finished by the next one that writes into their folder.
        force: True where existing ones may be replaced.
        why_not: see `check_output`.

    Yields:
        The paths to write to.

    Raises:
        OutputError: see `check_output`; also where writing fails.
    """
    for path in paths:
        check_output(path, force=force, why_not=why_not)
    first, done = paths[0], False
    try:
        work = WorkFolder(first.parent, [path.name for path in paths])
        try:
            parts = [work.new(path.name) for path in paths]
            yield parts
            for part in parts:
                sync_tree(part)
            work.set_ready()
            sync_folder(work.path)
            for part, path in zip(parts, paths, strict=True):
                _check_replaceable(path, why_not)  # something else may have come meanwhile
                put_in_place(part, path, work.old(path.name), force=force)
            sync_folder(first.absolute().parent)
            done = True
        finally:
            work.close(failed=not done)
    except FileExistsError as error:
        if error.filename not in map(str, paths):
            raise OutputError(f"{first}: cannot be written: {error.strerror}") from error
        raise OutputError(
            f"{error.filename}: has come while it was being written; use force=True to replace it"
        ) from None
    except OSError as error:
        raise OutputError(f"{first}: cannot be written: {error.strerror or error}") from error
