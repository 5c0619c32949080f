# SPDX-License-Identifier: Apache-2.0
"""Where a map goes on: free cells beside unknown ones, in clusters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.kernels.query.frontiers import MARK, join_marked, list_marked, mark_frontiers
from oddsmap.kernels.query.state_blocks import BLOCK_BITS
from oddsmap.odds import State
from oddsmap.query.places import CellGrid
from oddsmap.query.state_blocks import bit_of, fill_blocks
from oddsmap.short_repr import counted, described, extent_of

__all__ = ["Connectivity", "Frontier", "find_frontiers"]

Connectivity = Literal["sides", "corners"]
Box = tuple[npt.ArrayLike, npt.ArrayLike]


@dataclass(frozen=True, slots=True, eq=False)
class Frontier:
    """Free cells beside unknown ones, which touch each other.

    Attributes:
        cells: its cells, in order of their index, x changing fastest, shape (n, d).
        size: their number times their side: a length [m]; in 3D times the square of it: an area
            [m^2].
        centroid: mean of their centres [m], shape (d,). Of a bent frontier it may lie anywhere.
        goal: centre of the cell nearest to the centroid [m], shape (d,): a free place.
        box: lowest and highest corner of the cells in the map frame [m], shape (d,) each.
    """

    cells: IntArray
    size: float
    centroid: FloatArray
    goal: FloatArray
    box: tuple[FloatArray, FloatArray]

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield counted(len(self.cells), "cell")
        yield f"{self.size:.4g} {'m' if len(self.goal) == 2 else 'm²'}"
        yield f"goal {', '.join(f'{x:.6g}' for x in self.goal)} m"
        yield extent_of(*self.box)


class _Grid(CellGrid, Protocol):
    """A field of cells that knows where they are."""

    def centre_of(self, cells: npt.ArrayLike) -> FloatArray:
        """Centres [m], shape (n, d)."""


def find_frontiers(
    grid: _Grid,
    parts: Iterable[tuple[IntArray, npt.NDArray[np.int8]]],
    *,
    next_to: Connectivity,
    joined: Connectivity,
    min_size: float,
    min_cells: int,
    box: Box | None,
) -> list[Frontier]:
    """The frontiers of a map: arguments and errors as in `Queries.frontiers`.

    Args:
        grid: the map.
        parts: its known cells, some at a time: index, shape (n, d), and state, shape (n,).
        next_to: see `Queries.frontiers`, as all that follow.
        joined: likewise.
        min_size: likewise.
        min_cells: likewise.
        box: likewise.
    """
    d = grid.ndim
    beside, across = _steps(d, next_to, "next_to"), _steps(d, joined, "joined")
    least = _least_cells(min_size, min_cells, grid.resolution ** (d - 1))
    corners = None if box is None else _corners(box, d)
    blocks = fill_blocks(d, parts)
    key = np.empty(d, np.int64)
    free = np.uint8(bit_of(State.FREE))
    count = mark_frontiers(blocks, free, beside, key, np.empty(3**d, np.int64))
    where = np.empty((count, 2), np.int64)
    list_marked(blocks, where)
    if corners is not None:
        places = where[:, 1, None] >> (BLOCK_BITS * np.arange(d)) & ((1 << BLOCK_BITS) - 1)
        centre = grid.centre_of((blocks.coords[where[:, 0]] << BLOCK_BITS) + places)
        inside = ((centre >= corners[0]) & (centre < corners[1])).all(axis=1)
        blocks.states[tuple(where[~inside].T)] &= np.uint8(255 - MARK)
        where = where[inside]
    cells, cluster = np.empty((len(where), d), np.int64), np.empty(len(where), np.int64)
    number = join_marked(blocks, where, across, key, cells, cluster)
    sizes = np.bincount(cluster, minlength=number)
    kept = sizes[cluster] >= least
    cells, cluster = cells[kept], cluster[kept]
    # Blocks come in the order in which cells were first seen, which must not show.
    order = np.lexsort((*cells.T, cluster))
    cells, cluster = cells[order], cluster[order]
    starts = np.flatnonzero(np.diff(cluster, prepend=-1))
    groups = np.split(cells, starts[1:]) if len(starts) else []
    groups.sort(key=lambda group: (-len(group), group[0, ::-1].tolist()))
    return [_frontier(grid, group) for group in groups]


def _frontier(grid: _Grid, cells: IntArray) -> Frontier:
    d = grid.ndim
    centre = grid.centre_of(cells)
    centroid = centre.mean(axis=0)
    goal = centre[np.argmin(((centre - centroid) ** 2).sum(axis=1))]
    # A cell of a grid that lies askew reaches farther along the axes of the map.
    sides = grid.centre_of(np.eye(d, dtype=np.int64)) - grid.centre_of(np.zeros((1, d), np.int64))
    reach = np.abs(sides).sum(axis=0) / 2
    box = centre.min(axis=0) - reach, centre.max(axis=0) + reach
    return Frontier(cells, len(cells) * grid.resolution ** (d - 1), centroid, goal, box)


def _steps(ndim: int, connectivity: str, name: str) -> IntArray:
    """From a cell to each neighbour: of 2 d cells by their sides, of 3^d - 1 with corners."""
    if connectivity not in get_args(Connectivity):
        raise ConfigError(
            f'{name} is "sides" (4 neighbours in 2D, 6 in 3D) or "corners" (8, 26), got '
            f"{connectivity!r}"
        )
    steps = np.array(list(product((-1, 0, 1), repeat=ndim)), np.int64)
    far = np.abs(steps).sum(axis=1)
    return np.ascontiguousarray(steps[far == 1 if connectivity == "sides" else far > 0])


def _least_cells(min_size: float, min_cells: int, cell: float) -> float:
    if not 0.0 <= min_size < math.inf:
        raise ConfigError(f"min_size is 0 or more [m; in 3D m^2], got {min_size}")
    if isinstance(min_cells, bool) or not isinstance(min_cells, int | np.integer) or min_cells < 1:
        raise ConfigError(
            f"min_cells is a whole number from 1 on, got {min_cells!r}: metres are min_size"
        )
    # 3 cells of 0.1 m are 0.3 m, whatever the rounding.
    return max(float(min_cells), math.ceil(min_size / cell * (1.0 - 1e-12)))


def _corners(box: Box, ndim: int) -> tuple[FloatArray, FloatArray]:
    try:
        lo, hi = (np.asarray(corner, np.float64) for corner in box)
    except (TypeError, ValueError):
        lo = hi = np.empty(0)
    if lo.shape != (ndim,) or hi.shape != (ndim,) or not (lo < hi).all():
        raise InputError(
            f"a box is its lowest and its highest corner, {ndim} numbers [m] each, got {box!r}"
        )
    return lo, hi
