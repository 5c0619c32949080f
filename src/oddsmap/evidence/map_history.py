# SPDX-License-Identifier: Apache-2.0
"""A map with its history: each addition is a commit of an Icechunk repository.

A commit writes the shards that it reaches, and nothing that all commits share: the arrays have one
extent and one type for good, and where evidence came from is noted with the commit. Commits that
reach different shards therefore go one after the other as they are; of two that reach one shard the
later is made again, from what is there then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import date
from typing import Any, Generic, TypeVar

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError, OddsmapError, OutputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.history_log import (
    ADDED,
    SUBTRACTED,
    MapCommit,
    commit_of,
    note_of,
    place_in,
    provenance_of,
    said_of,
)
from oddsmap.evidence.history_shards import (
    EXTENT,
    HistoryShards,
    new_header_files,
    packed,
    place_of_cell_0,
)
from oddsmap.evidence.store import empty_map
from oddsmap.evidence.stored_tiles import reached_shards
from oddsmap.map_files.icechunk_repository import CommitRecord, Repository
from oddsmap.map_files.icechunk_snapshot import Snapshot
from oddsmap.short_repr import described

__all__ = ["MapHistory"]

E = TypeVar("E", bound=Evidence)
T = TypeVar("T", bound=Evidence)

# Each time that one begins again another has committed.
_TRIES = 1000


class MapHistory(Generic[E]):
    """A map that is kept with all that it was: an Icechunk repository.

        city = oddsmap.EvidenceMap.history("city.icechunk")
        city.add(monday, "Monday's drive")
        city.load(at="2026-11-24").log_odds().save_ros("city.yaml")

    Any number of processes may add at the same time; each addition is there as a whole or not at
    all, and the sum is exact. `EvidenceMap.history` makes one.

    Args:
        place: a folder, by custom NAME.icechunk, which the first addition makes; or any
            `icechunk.Storage`.
        kind: what its states are, as `EvidenceMap`.

    Raises:
        InputError: from whatever reads or writes: the extra `icechunk` is not installed, there is
            no such repository, no map of ours in it, or it is damaged.

    Source: https://icechunk.io/en/stable/spec/
    """

    def __init__(self, place: Any, kind: type[E]) -> None:
        self._repository, self._kind = Repository(place), kind

    def __repr__(self) -> str:
        return described(self, lambda: [self._repository.short_name])

    @property
    def name(self) -> str:
        """Of the folder or the storage."""
        return self._repository.name

    def log(self) -> list[MapCommit]:
        """All commits that are part of the newest state, the newest first."""
        with self._repository.reading():
            return [commit_of(each) for each in self._repository.commits()]

    def commit(self, at: str | date | None = None) -> MapCommit:
        """The commit that `load` takes, of the same arguments and errors."""
        with self._repository.reading():
            return commit_of(self._until(at)[0])

    def add(
        self,
        evidence: Evidence,
        message: str | None = None,
        *,
        any_sensor: bool = False,
        waiting: Callable[[], None] = lambda: None,
    ) -> MapCommit:
        """Add evidence, as `Evidence.merge` would; the first makes the map, with its settings.

        Args:
            evidence: what is to be added.
            message: says what it is; None: the names of its logs.
            any_sensor: as in `Evidence.merge`.
            waiting: called once where another process is committing.

        Returns:
            The commit.

        Raises:
            InputError: the two do not add up, it has no evidence, or lies beyond 2^30 cells from
                the frame's origin.
            MapTooLargeError: a cell would pass 2^46 votes.
            OutputError: it cannot be written. In all cases the map is as it was.
        """
        return self._changed(ADDED, evidence, message, any_sensor, waiting)

    def subtract(
        self,
        evidence: Evidence,
        message: str | None = None,
        *,
        any_sensor: bool = False,
        waiting: Callable[[], None] = lambda: None,
    ) -> MapCommit:
        """Take evidence out again, as `Evidence.subtract` would; what was before stays in the log.

        Arguments, what is returned and raised as in `add`; also InputError where a cell has less
        than is to be taken out.
        """
        return self._changed(SUBTRACTED, evidence, message, any_sensor, waiting)

    def load(self, at: str | date | None = None) -> E:
        """The map as it is, or as it was.

        Args:
            at: a commit's id or how it begins; or a date or time, of which the last commit until
                then is taken: ISO 8601, in UTC where it has no offset, a date to its end. None: the
                newest.

        Raises:
            InputError: no such commit, or it is damaged.
        """
        with self._repository.reading():
            commits = self._until(at)
            grid, shards = self._opened(self._repository.snapshot(commits[0].id), self._kind)
            shards.read_into(grid, None)
            grid.provenance = provenance_of(grid, commits)
        return grid

    def like(self) -> E:
        """The newest state without its evidence: a map of its settings; errors as in `load`."""
        with self._repository.reading():
            commits = self._until(None)
            grid, _ = self._opened(self._repository.snapshot(commits[0].id), self._kind)
            grid.provenance = provenance_of(grid, commits)
        return grid

    def _until(self, at: str | date | None) -> list[CommitRecord]:
        """The commit that is meant and those before it, the newest first."""
        commits = self._repository.commits()
        return commits[place_in(commits, at, self.name) :]

    def _changed(
        self,
        done: str,
        evidence: Evidence,
        message: str | None,
        any_sensor: bool,
        waiting: Callable[[], None],
    ) -> MapCommit:
        repository, note = self._repository, note_of(done, evidence)
        reached = self._reached(evidence)
        if done == ADDED:
            with repository.one_at_a_time(waiting):
                repository.make()
        for _ in range(_TRIES):
            snapshot = repository.to_change()
            self._change(snapshot, done, evidence, reached, any_sensor=any_sensor)
            with repository.one_at_a_time(waiting), repository.writing():
                made = snapshot.commit(message or said_of(note), note)
            if made is not None:
                return commit_of(repository.commit(made))
        raise OutputError(
            f"{self.name}: another process has changed the same shards each of {_TRIES} times: "
            "begin again when fewer write"
        )

    def _change(
        self,
        snapshot: Snapshot,
        done: str,
        evidence: Evidence,
        reached: IntArray,
        *,
        any_sensor: bool,
    ) -> None:
        """Write the shards of the sum, or of the difference."""
        files: dict[str, bytes | None] = {}
        with self._repository.reading():
            if done == ADDED and snapshot.read(["zarr.json"]) == [None]:
                total: Evidence = evidence.like()
                files |= new_header_files(total)
            else:
                total, shards = self._opened(snapshot, Evidence)
                with self._named():
                    total.check_same_kind_as(evidence, any_sensor=any_sensor, done=done)
                # Where nothing is left there is no file.
                files |= dict.fromkeys(shards.read_into(total, reached))
        with self._named():
            if done == ADDED:
                total.merge(evidence, any_sensor=any_sensor)
            else:
                total.subtract(evidence, any_sensor=any_sensor)
        with self._repository.writing():
            snapshot.write(files | packed(total))

    def _opened(self, snapshot: Snapshot, kind: type[T]) -> tuple[T, HistoryShards]:
        shards = HistoryShards(self.name, snapshot)
        return empty_map(shards.path, kind, shards.header), shards

    def _reached(self, evidence: Evidence) -> IntArray:
        if evidence.bounds() is None:
            raise InputError(f"{self.name}: what is to be committed holds no evidence")
        reached, limit = reached_shards(evidence), place_of_cell_0(evidence.ndim)
        if (reached < -limit).any() or (reached >= limit).any():
            raise InputError(
                f"{self.name}: there are cells beyond {EXTENT // 2} cells from the frame's origin, "
                "where a map with a history ends: begin the frame nearer, or use larger cells"
            )
        return reached

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Say of which map an error is."""
        try:
            yield
        except OddsmapError as error:
            raise type(error)(f"{self.name}: {error}") from None
