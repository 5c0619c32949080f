# SPDX-License-Identifier: Apache-2.0
"""The Icechunk repository that a map with its history is kept in: where it lies, its commits."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from oddsmap.atomic_write import one_writer
from oddsmap.errors import InputError, OddsmapError, OutputError
from oddsmap.map_files.icechunk_snapshot import Snapshot
from oddsmap.map_files.zarr_snapshot import DAMAGE

__all__ = ["CommitRecord", "Repository"]

_BRANCH = "main"
_REF = "refs", f"branch.{_BRANCH}"
# Where the empty state that a repository begins with has files; and what else there may be then.
_OF_THE_FIRST = {"snapshots", "transactions", "config.yaml"}
_FOLDERS = {*_OF_THE_FIRST, "refs", "chunks", "manifests"}


class CommitRecord(NamedTuple):
    """What a repository knows of a commit."""

    id: str
    time: datetime
    message: str
    facts: dict[str, Any]
    """What was noted with it; empty for commits of other programs."""


class Repository:
    """A repository in a folder, or in any storage of Icechunk.

    Args:
        place: a folder, or an `icechunk.Storage`.
    """

    def __init__(self, place: Any) -> None:
        self.path = Path(place) if isinstance(place, str | os.PathLike) else None
        self.name = str(place) if self.path is not None else type(place).__name__
        self.short_name = self.name if self.path is None else self.path.name
        self._storage = place

    def _icechunk(self) -> Any:
        """The package, which is loaded when it is used.

        Raises:
            InputError: it is not installed.
        """
        try:
            import icechunk
        except ImportError:
            raise InputError(
                f"{self.name}: maps with a history are kept by Icechunk: "
                'pip install "oddsmap[icechunk]"'
            ) from None
        if "ICECHUNK_LOG" not in os.environ:
            # It warns of writers of one folder, which have a lock here, and of each rebase that
            # finds a conflict, after which what was to be added is added again.
            icechunk.set_logs_filter("icechunk=error")
        return icechunk

    def snapshot(self, commit: str) -> Snapshot:
        """The files of a commit."""
        with self.reading():
            return Snapshot(self._opened().readonly_session(snapshot_id=commit))

    def to_change(self) -> Snapshot:
        """The files of the newest commit, to be changed and committed."""
        with self.reading():
            return Snapshot(self._opened().writable_session(_BRANCH))

    def commits(self) -> list[CommitRecord]:
        """All commits, the newest first, but for the empty one that a repository begins with."""
        with self.reading():
            found = self._opened().ancestry(branch=_BRANCH)
            return [_record(each) for each in found if each.parent_id is not None]

    def commit(self, commit: str) -> CommitRecord:
        """What is known of one."""
        with self.reading():
            return _record(self._opened().lookup_snapshot(commit))

    @contextmanager
    def one_at_a_time(self, waiting: Callable[[], None]) -> Iterator[None]:
        """Hold the lock of a folder, in which Icechunk does not notice commits at the same moment.

        Other storages know whether what they replace is what was read, and need none.

        Raises:
            OutputError: nothing can be written beside it.
        """
        if self.path is None:
            yield
        else:
            # By whatever name it is called: of one folder there is one lock.
            with one_writer(self.path.resolve(), waiting):
                yield

    def make(self) -> None:
        """Make the repository where there is none.

        Raises:
            OutputError: something else is there, or it cannot be written.
        """
        icechunk = self._icechunk()

        path = self.path
        if path is not None and path.exists() and not self._is_there():
            if _is_begun(path):
                shutil.rmtree(path)  # Icechunk makes one in an empty folder alone
            elif not path.is_dir() or any(path.iterdir()):
                raise OutputError(
                    f"{path}: is no Icechunk repository: give another name, by custom NAME.icechunk"
                )
        with self.writing():
            icechunk.Repository.open_or_create(self._opened_storage())

    def _is_there(self) -> bool:
        return self.path is None or self.path.joinpath(*_REF, "ref.json").is_file()

    def _opened(self) -> Any:
        icechunk = self._icechunk()

        if not self._is_there():
            there = Path(self.name).exists()
            what = "not an Icechunk repository" if there else "no such folder: add a map first"
            raise InputError(f"{self.name}: {what}")
        return icechunk.Repository.open(self._opened_storage())

    def _opened_storage(self) -> Any:
        icechunk = self._icechunk()

        if self.path is None:
            return self._storage
        return icechunk.local_filesystem_storage(str(self.path.absolute()))

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Say in one line, as an InputError, what reading raises."""
        icechunk = self._icechunk()

        try:
            yield
        except OddsmapError:
            raise
        except (icechunk.IcechunkError, *DAMAGE) as error:
            raise InputError(f"{self.name}: cannot be read: {_one_line(error)}") from None

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Say in one line, as an OutputError, what writing raises."""
        icechunk = self._icechunk()

        try:
            yield
        except (icechunk.IcechunkError, OSError) as error:
            raise OutputError(f"{self.name}: cannot be written: {_one_line(error)}") from None


def _is_begun(path: Path) -> bool:
    """Whether a folder holds what a run has left that was killed as it made a repository."""
    if not path.is_dir() or "snapshots" not in (names := {each.name for each in path.iterdir()}):
        return False
    files = [file.relative_to(path).parts for file in path.rglob("*") if not file.is_dir()]
    first = [parts for parts in files if parts[0] in _OF_THE_FIRST or parts[:2] == _REF]
    count = sum(parts[0] == "snapshots" for parts in files)
    return names <= _FOLDERS and len(first) == len(files) and count <= 1


def _record(found: Any) -> CommitRecord:
    return CommitRecord(found.id, found.written_at, found.message, found.metadata)


def _one_line(error: Exception) -> str:
    said = str(error).partition("context:")[0].replace("|", " ")
    return " ".join(said.split()).removeprefix("x ")[:200]
