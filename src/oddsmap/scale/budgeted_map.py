# SPDX-License-Identifier: Apache-2.0
"""A map that is built within a budget of memory, and saved in the end.

with BudgetedMap(evidence, Path("town.zarr"), memory) as building:
    add_log(building.evidence, log)     # full memory goes to the disk as a partial sum
    totals = building.total(SavedTotals)
    building.save()                     # sums, shard by shard
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Generic, Self, TypeVar

from oddsmap.atomic_write.work_folder import WorkFolder
from oddsmap.errors import OutputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.saved_totals import SavedTotals
from oddsmap.evidence.store import new_saved_map, save_map, stores_of
from oddsmap.evidence.tiles import NOTHING, Census, TileStore
from oddsmap.limits import memory_limit
from oddsmap.map_files.side_by_side import do_side_by_side
from oddsmap.scale.spilling_tiles import Budget, SpillingTiles
from oddsmap.scale.tile_runs import Place, TileRuns

__all__ = ["BudgetedMap"]

E = TypeVar("E", bound=Evidence)
T = TypeVar("T", bound=SavedTotals)

_NAMES = ("votes", "lengths")


class BudgetedMap(Generic[E]):
    """A map that is built within a budget of memory.

    Where its tiles would pass the budget all of them are written to a hidden folder beside the
    output, which is gone in the end, whatever happens; the run after one that was killed removes
    what that left.

    Args:
        evidence: an empty map, to which evidence is added while this is open.
        output: the map to write.
        memory: bytes that its tiles may take; None: as much as there is, and none is written.
    """

    def __init__(self, evidence: E, output: Path, memory: int | None) -> None:
        self.evidence, self._output = evidence, output
        self._budget = None if memory is None else Budget(min(memory, memory_limit()))
        self._runs: list[TileRuns | None] = [None] * len(stores_of(evidence))
        self._stores: list[SpillingTiles] = []
        self._work: WorkFolder | None = None
        self._lock = threading.Lock()
        self._censuses: list[Census] | None = None

    def __enter__(self) -> Self:
        evidence, budget = self.evidence, self._budget
        if budget is not None:
            self._stores = [
                SpillingTiles(evidence.ndim, evidence.tiles.side, self._write_to(number), budget)
                for number in range(len(self._runs))
            ]
            evidence.tiles, *lengths = self._stores
            if lengths:
                evidence.lengths = lengths[0]
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._work is not None:
            self._work.close(failed=kind is not None)

    @property
    def spill_count(self) -> int:
        """How often tiles were written to the disk."""
        return sum(runs.run_count for runs in self._runs if runs is not None)

    @property
    def spilled_bytes(self) -> int:
        """How many bytes that were."""
        return sum(runs.bytes_written for runs in self._runs if runs is not None)

    @property
    def most_bytes(self) -> int:
        """The most that tiles have taken in memory [bytes]."""
        if self._budget is None:
            return self.evidence.nbytes
        self._budget.count()
        return self._budget.most

    def total(self, kind: type[T]) -> T:
        """Count and sum what the map holds.

        Args:
            kind: what to make of it, `SavedTotals` or one that knows more.

        Raises:
            OutputError: what was written to the disk cannot be read back.
            MapTooLargeError: a cell would pass 2^46 votes.
        """
        totals = kind()
        totals.like = self.evidence
        if not self._spilled:
            totals.add(self.evidence)
            return totals
        for tiles in self._stores:
            tiles.spill()
        found = [NOTHING] * len(self._runs)

        def add(place: Place) -> None:
            part = self._part(place)
            censuses = [tiles.census() for tiles in stores_of(part)]
            with self._lock:
                totals.add(part)
                found[:] = [one.joined(more) for one, more in zip(found, censuses, strict=True)]

        do_side_by_side(add, self._places())
        self._censuses = found
        return totals

    def save(self, *, force: bool = False) -> None:
        """Write the map; errors as in `save_map` and `total`.

        Args:
            force: True if an existing map may be replaced.
        """
        if not self._spilled:
            save_map(self.evidence, self._output, force=force)
            return
        if self._censuses is None or any(tiles.count for tiles in self._stores):
            self.total(SavedTotals)
        censuses = self._censuses or ()
        with new_saved_map(self.evidence, censuses, self._output, force=force) as writer:

            def write(place: Place) -> None:
                for shard in writer.shards(self._part(place)):
                    writer.write(shard)

            do_side_by_side(write, self._places())

    @property
    def _spilled(self) -> bool:
        return any(runs is not None for runs in self._runs)

    def _places(self) -> list[Place]:
        """All shards of the map, z before y before x."""
        found = {place for runs in self._runs if runs is not None for place in runs.places()}
        return sorted(found, key=lambda place: place[::-1])

    def _part(self, place: Place) -> E:
        """What the map holds in a shard."""
        part = self.evidence.like()
        votes, lengths = (*self._runs, None)[:2]
        if votes is not None:
            part.tiles = votes.read(place)
        if lengths is not None:
            part.lengths = lengths.read(place)
        return part

    def _write_to(self, number: int) -> Callable[[TileStore], None]:
        return lambda tiles: self._runs_of(number).write(tiles)

    def _runs_of(self, number: int) -> TileRuns:
        """Where the tiles of a store go; a folder is made when the first do."""
        with self._lock:
            try:
                if self._work is None:
                    parent = self._output.absolute().parent
                    self._work = WorkFolder(parent, [self._output.name])
            except OSError as error:
                raise OutputError(
                    f"{self._output}: cannot be written: {error.strerror or error}"
                ) from error
            runs = self._runs[number]
            if runs is None:
                file = self._work.new(f"{self._output.name}.{_NAMES[number]}")
                evidence = self.evidence
                runs = TileRuns(file, evidence.ndim, evidence.tiles.side, self._output)
                self._runs[number] = runs
            return runs
