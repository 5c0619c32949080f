# SPDX-License-Identifier: Apache-2.0
"""The measurements of a log by number, and their poses, for every log that can be iterated."""

from __future__ import annotations

import operator
from collections import deque
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, overload

from oddsmap.poses.pose import Pose
from oddsmap.short_repr import counted, described

__all__ = ["LogItems", "ReadOnDemand"]


class LogItems:
    """What `log[i]` and `log.poses` mean: iterating decides. Made to be derived from."""

    __slots__ = ()

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self: Any) -> Iterator[str]:
        yield Path(self.path).name
        yield self.format
        count = self.scan_count
        yield "scans not counted" if count is None else counted(count, "scan")
        if len(self.sensors) > 1:
            yield counted(len(self.sensors), "sensor")
        if lost := self.skipped.total():
            yield f"{lost:,} skipped"
        if self.notes:
            yield counted(len(self.notes), "note")

    def __iter__(self) -> Iterator[Any]:
        """The measurements in file order."""
        raise NotImplementedError

    @overload
    def __getitem__(self, number: int) -> Any: ...
    @overload
    def __getitem__(self, number: slice) -> list[Any]: ...
    def __getitem__(self, number: int | slice) -> Any:
        """The measurement of a number, as iterating gives it; of a slice, a list of them.

        A log that does not keep its measurements may have to read all those before it.

        Args:
            number: from 0; from the end, if negative.

        Raises:
            IndexError: there are fewer.
            InputError: one that has to be read cannot be.
        """
        if isinstance(number, slice):
            return self._slice(number)
        i = operator.index(number)
        found = list(islice(self, i, i + 1)) if i >= 0 else list(deque(self, maxlen=-i))
        if not found or (i < 0 and len(found) < -i):
            raise IndexError(f"the log has no scan {i}")
        return found[0]

    def _slice(self, part: slice) -> list[Any]:
        bounds = [operator.index(b) for b in (part.start, part.stop, part.step) if b is not None]
        if min(bounds, default=0) >= 0 and part.step != 0:
            return list(islice(self, part.start, part.stop, part.step))
        return list(self)[part]

    @property
    def poses(self) -> list[Pose]:
        """Of each measurement the pose of its sensor, map_from_sensor; reads the whole log."""
        return [scan.map_from_sensor for scan in self]


class ReadOnDemand(LogItems):
    """A log that is pickled as the way to open it: its files have to be where it comes back.

    What it has counted while it was read is counted again there.
    """

    __slots__ = ("_opened_by",)
    _opened_by: tuple[Callable[..., Any], tuple[Any, ...]]

    def opened_by(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Remember which call opened it."""
        object.__setattr__(self, "_opened_by", (function, arguments))

    def __reduce__(self) -> Any:
        """What `pickle` and `copy` ask for."""
        return getattr(self, "_opened_by", None) or object.__reduce_ex__(self, 2)
