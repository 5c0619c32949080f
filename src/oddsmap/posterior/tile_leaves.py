# SPDX-License-Identifier: Apache-2.0
"""Log odds of the cells of a 3D map as leaves of an octree, made of some tiles at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.evidence.octree_order import octree_parts
from oddsmap.evidence.tiles import TileStore
from oddsmap.map_files.fields import LeafPart, OfLogOdds
from oddsmap.map_files.morton import unmorton

__all__ = ["OfCells", "TileLeaves"]

OfCells: TypeAlias = Callable[[IntArray, IntArray, Callable[[], IntArray]], npt.NDArray[Any]]
"""A function of cells: of their hits and passes [units], and of what gives their index."""


@dataclass(frozen=True, slots=True, eq=False)
class TileLeaves:
    """Leaves for files, see `oddsmap.map_files.fields.Leaves`: one for each cell with evidence.

    Args:
        tiles: nodes of the octree, see `oddsmap.evidence.octree_order.has_octree_order`.
        resolution: side of a cell [m].
        first: the cell of code 0.
        shift: the cell of the map that is cell 0 of the leaves, shape (3,).
        box: the box of the cells with evidence; None: there are none.
        values: gives a function of cells for a function of their log odds.
    """

    tiles: TileStore
    resolution: float
    first: IntArray
    shift: IntArray
    box: tuple[IntArray, IntArray] | None
    values: Callable[[OfLogOdds], OfCells]

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of known cells: first index and past the last, shape (3,); None if empty."""
        return None if self.box is None else (self.box[0] - self.shift, self.box[1] - self.shift)

    @property
    def base(self) -> IntArray:
        """The cell of code 0, counted as the leaves are."""
        return self.first - self.shift

    def parts(self, function: OfLogOdds) -> Iterator[LeafPart]:
        """The leaves in order, some at a time: Morton code, level, and a function of log odds."""
        values = self.values(function)
        for code, hits, passes in octree_parts(self.tiles, self.first):
            value = values(hits, passes, partial(_cells, code, self.first))
            yield LeafPart(code, np.zeros(len(code), np.uint8), value)


def _cells(code: IntArray, base: IntArray) -> IntArray:
    return unmorton(code) + base
