# SPDX-License-Identifier: Apache-2.0
"""Where an output is made: a hidden folder beside its place, locked by who makes it.

    .oddsmap-3f9c2a1b7d604e58.part/
        owner            locked (flock) as long as its writer lives; says which outputs it is for
        new/intel.zarr   what is being made
        old/intel.zarr   what was there, for the moment between two renames
        ready            all in `new` is complete and on the disk

The lock ends with its process, whichever way that ends, so whoever gets it knows that the folder is
a dead run's: no process ids, which are used again and mean nothing on another host. Where a file
system has no locks nobody can tell, and what is left stays.
"""

from __future__ import annotations

import glob
import json
import os
import re
import secrets
import time
import warnings
from contextlib import suppress
from pathlib import Path

from oddsmap.atomic_write.lock import is_open_at, try_lock, unlock
from oddsmap.atomic_write.swap import remove, rename_to_free
from oddsmap.atomic_write.writer_lock import LOCK_NAME, remove_dead_lock
from oddsmap.errors import RecoveryWarning

__all__ = ["WorkFolder", "clear_dead", "put_back"]

_NAME = re.compile(r"\.oddsmap-[0-9a-f]{16}\.part")
_OWNER, _NEW, _OLD, _READY = "owner", "new", "old", "ready"
# Threads may still be writing where a second interrupt comes while they are waited for [s].
_SETTLE = 0.05


class WorkFolder:
    """A locked work folder for outputs of one folder.

    Args:
        parent: the folder of the outputs.
        names: of the outputs, in the order in which they are put in place.

    Raises:
        OSError: it cannot be made.
    """

    def __init__(self, parent: Path, names: list[str]) -> None:
        self.parent, self.names = parent, names
        self.path, self._lock = _claim_new(parent)
        try:
            os.write(self._lock, json.dumps({"outputs": names, "pid": os.getpid()}).encode())
            for name in (_NEW, _OLD):
                (self.path / name).mkdir()
        except BaseException:
            self.close()
            raise

    def new(self, name: str) -> Path:
        """Where an output is made."""
        return self.path / _NEW / name

    def old(self, name: str) -> Path:
        """Where an old one goes for a moment."""
        return self.path / _OLD / name

    def set_ready(self) -> None:
        """Say that all outputs are complete, so that another run may finish what was begun."""
        (self.path / _READY).touch()

    def close(self, *, failed: bool = False) -> None:
        """Put back what stands aside of a place that is empty, and leave nothing.

        Args:
            failed: True where threads may still be writing into it.
        """
        try:
            _restore(self.path, self.parent)
            _empty(self.path)
            if failed:
                time.sleep(_SETTLE)
                _empty(self.path)
        finally:
            unlock(self._lock)
            _empty(self.path)  # Windows removes no file that is open


def clear_dead(parent: Path) -> None:
    """Finish, put back or clear what killed runs left in a folder; each is said in a warning."""
    try:
        with os.scandir(parent) as entries:
            names = sorted(entry.name for entry in entries)
    except OSError:
        return
    for name in filter(LOCK_NAME.fullmatch, names):
        remove_dead_lock(parent / name)
    for folder in (parent / name for name in filter(_NAME.fullmatch, names)):
        lock = _claim_dead(folder)
        if lock is None:
            continue
        try:
            outputs = _outputs_of(folder)
            begun = outputs or len(list(folder.iterdir())) > 1  # else its writer begins elsewhere
            finished, restored = _finish(folder, parent, outputs), _restore(folder, parent)
            _empty(folder)
        finally:
            unlock(lock)
        _empty(folder)
        for name in finished:
            _say(f"{parent / name}: a run was killed while it put its files in place; finished")
        for name in restored:
            _say(f"{parent / name}: a run was killed while it replaced it; the old one is back")
        if begun and not (finished or restored or folder.exists()):
            of = f", {' and '.join(outputs)}," if outputs else ""
            _say(f"{folder}: what a killed run left of its output{of} is removed")


def put_back(path: Path) -> bool:
    """Put back what a killed run had set aside of a place that is empty.

    Returns:
        True if something is there, or will be in a moment: a run that lives is replacing it.
    """
    if os.path.lexists(path):
        return True
    parent = path.absolute().parent
    aside = f".oddsmap-*.part/{_OLD}/{glob.escape(path.name)}"
    if not any(parent.glob(aside)):
        return os.path.lexists(path)
    clear_dead(parent)
    return True


def _claim_new(parent: Path) -> tuple[Path, int]:
    while True:
        folder = parent / f".oddsmap-{secrets.token_hex(8)}.part"
        try:
            folder.mkdir()
            lock = os.open(folder / _OWNER, os.O_CREAT | os.O_EXCL | os.O_RDWR)
        except (FileExistsError, FileNotFoundError):
            # Another run took the folder for a dead one's before it was locked: once more.
            if not parent.is_dir():
                raise
            continue
        if try_lock(lock) is not False and is_open_at(lock, folder / _OWNER):
            return folder, lock
        os.close(lock)


def _claim_dead(folder: Path) -> int | None:
    """The lock of a work folder; None if its writer lives, or where nobody can tell."""
    owner = folder / _OWNER
    try:
        with suppress(OSError):
            folder.rmdir()  # an empty one holds nothing, and one that lives is made anew
        try:
            lock = os.open(owner, os.O_RDWR)
        except FileNotFoundError:  # killed before it was made, or by one who cleared the folder
            lock = os.open(owner, os.O_CREAT | os.O_EXCL | os.O_RDWR)
    except OSError:
        return None
    if try_lock(lock) and is_open_at(lock, owner):
        return lock
    os.close(lock)
    return None


def _outputs_of(folder: Path) -> list[str]:
    try:
        names = json.loads((folder / _OWNER).read_bytes())["outputs"]
    except (OSError, ValueError, LookupError, TypeError):
        return []  # killed before it was written
    plain = isinstance(names, list) and all(
        isinstance(name, str) and name == Path(name).name for name in names
    )
    return names if plain else []


def _finish(folder: Path, parent: Path, outputs: list[str]) -> list[str]:
    """Put the rest of several files in place where some are already; which those were."""
    left = [name for name in outputs if os.path.lexists(folder / _NEW / name)]
    if not (folder / _READY).exists() or len(left) in (0, len(outputs)):
        return []
    for name in left:
        with suppress(OSError):
            (folder / _NEW / name).replace(parent / name)
    return left


def _restore(folder: Path, parent: Path) -> list[str]:
    """Put back what stands aside of a place that is empty; which those were."""
    try:
        aside = sorted(path.name for path in (folder / _OLD).iterdir())
    except OSError:
        return []
    restored = []
    for name in aside:
        with suppress(OSError):
            rename_to_free(folder / _OLD / name, parent / name)
            restored.append(name)
    return restored


def _empty(folder: Path) -> None:
    """Remove a work folder, what says whose it is last."""
    with suppress(OSError):
        for path in list(folder.iterdir()):
            if path.name != _OWNER:
                remove(path)
        remove(folder / _OWNER)
        folder.rmdir()


def _say(what: str) -> None:
    warnings.warn(what, RecoveryWarning, stacklevel=2)
