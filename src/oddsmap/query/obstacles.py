# SPDX-License-Identifier: Apache-2.0
"""Which cells of a map are obstacles, as an array of a box."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.errors import ConfigError
from oddsmap.kernels.query.distances import mark_cells
from oddsmap.odds import State, Thresholds
from oddsmap.query.boxes import Box
from oddsmap.query.squared_distances import Mask

__all__ = ["ObstacleNames", "Obstacles", "View", "Watch", "read_marks"]

_Name = Literal["occupied", "unknown", "free", "undecided"]
ObstacleNames = _Name | tuple[_Name, ...] | list[_Name]


class Watch(Protocol):
    """Knows where a view's map has changed since it was last asked."""

    def changed(self, view: object) -> Region | None:
        """The box of cells outside which a view has the states it had; None: there is none."""


class View(Protocol):
    """A view of occupancy, as distances need it."""

    @property
    def ndim(self) -> int:
        """2 or 3."""

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of known cells; None: there are none."""

    def _state_parts(
        self, thresholds: Thresholds | None, within: Region | None = None
    ) -> Iterator[tuple[IntArray, npt.NDArray[np.int8]]]: ...

    def _state_marks(self, marks: Mask, thresholds: Thresholds | None, within: Region) -> Mask: ...

    def _map_from_cells(self) -> tuple[FloatArray, FloatArray] | None: ...

    def _watch(self, within: Region | None) -> Watch | None: ...


class Obstacles:
    """What counts as an obstacle: cells of some states.

    Args:
        names: the states.
        thresholds: what is free and what is occupied; None: the view's.

    Raises:
        ConfigError: there is no such state.
    """

    def __init__(self, names: ObstacleNames, thresholds: Thresholds | None) -> None:
        given = (names,) if isinstance(names, str) else tuple(names)
        if not given or not set(given) <= set(get_args(_Name)):
            known = ", ".join(get_args(_Name))
            raise ConfigError(
                f"obstacles are cells of one or several states, {known}; got {names!r}"
            )
        self.thresholds = thresholds
        self.outside = int("unknown" in given)
        """Whether cells outside all known ones are obstacles."""
        self._marks = np.zeros(256, np.uint8)
        for name in given:
            self._marks[State[name.upper()] % 256] = 1

    def read(self, view: View, box: Box) -> Mask:
        """1 for the obstacles of a box, 0 for other cells, in its shape."""
        return view._state_marks(self._marks, self.thresholds, (box.lo, box.hi))

    def cells(self, view: View) -> IntArray:
        """The known cells that are obstacles, shape (n, d), x first."""
        parts = [np.empty((0, view.ndim), np.int64)]
        for index, state in view._state_parts(self.thresholds):
            marks = self._marks[np.ascontiguousarray(state, np.int8).view(np.uint8)]
            parts.append(index[marks != 0])
        return np.concatenate(parts)


def read_marks(view: View, box: Box, marks: Mask, thresholds: Thresholds | None) -> Mask:
    """What a table has for the state of each cell of a box, in its shape.

    Args:
        view: the map.
        box: the cells.
        marks: by state, taken modulo 256, shape (256,).
        thresholds: what is free and what is occupied; None: the view's.
    """
    mask = np.full(box.shape, marks[State.UNKNOWN % 256], np.uint8)
    if mask.size:
        flat = mask.reshape(-1)
        for index, state in view._state_parts(thresholds, (box.lo, box.hi)):
            of_cells = marks[np.ascontiguousarray(state, np.int8).view(np.uint8)]
            mark_cells(np.ascontiguousarray(index, np.int64), of_cells, box.lo, box.hi, flat)
    return mask
