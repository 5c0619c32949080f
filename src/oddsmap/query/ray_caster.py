# SPDX-License-Identifier: Apache-2.0
"""Rays through the states of cells: the first that ends each."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.kernels.query.rays import walk_rays
from oddsmap.kernels.query.stop_tree import SIDE_BITS, StopTree
from oddsmap.odds import State
from oddsmap.query.given_numbers import check_numbers, check_threads
from oddsmap.query.places import CellGrid, check_places, points_in
from oddsmap.query.scan_at_poses import Frame
from oddsmap.query.state_blocks import bit_of, fill_blocks
from oddsmap.query.stop_tree import plant
from oddsmap.short_repr import described, in_bytes, short_repr

__all__ = ["RayCaster", "RayHits", "Until", "Walker", "rays_in"]

StateName = Literal["occupied", "unknown", "free", "undecided"]
Until = StateName | tuple[StateName, ...] | list[StateName]

Walker = Callable[
    [FloatArray, FloatArray, float], tuple[FloatArray, IntArray, npt.NDArray[np.uint8]]
]

# A direction may be off by what single precision makes of one.
_UNIT = 1e-6
# Rays handed to a thread at a time.
_BATCH = 1 << 14


@dataclass(frozen=True, slots=True, eq=False)
class RayHits:
    """What rays met.

    Attributes:
        distance: from the origin to where the ray enters the cell that ended it [m], shape (n,); 0
            where that is the cell it starts in, infinity where nothing ended it before max_range.
        cell: the cell that ended it, shape (n, d), x first; `NO_CELL` in every place where there is
            none, which is refused wherever cells are taken.
        ended_by: value of `oddsmap.State` of that cell, shape (n,); `MAX_RANGE` where none is.
    """

    MAX_RANGE: ClassVar[int] = -2
    NO_CELL: ClassVar[int] = -(1 << 63)

    distance: FloatArray
    cell: IntArray
    ended_by: npt.NDArray[np.int8]

    __repr__ = short_repr

    @property
    def met(self) -> BoolArray:
        """True where a cell ended the ray."""
        return np.isfinite(self.distance)


class RayCaster:
    """The states of a map's cells at one moment, for rays.

    Args:
        grid: the map.
        parts: its known cells, some at a time: index, shape (n, d), and state, shape (n,); all
            others are unknown.
        frame: where the map's cells count from, if not from the map frame: map_from_grid as
            rotation, shape (d, d), and translation [m], shape (d,).
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield f"{self.ndim}D"
        yield f"cells of {self.resolution:g} m"
        yield in_bytes(self.nbytes)

    def __init__(
        self,
        grid: CellGrid,
        parts: Iterable[tuple[IntArray, npt.NDArray[np.int8]]],
        *,
        frame: Frame | None = None,
    ) -> None:
        self.ndim, self.resolution = grid.ndim, grid.resolution
        self._frame = frame
        self._blocks = fill_blocks(grid.ndim, parts)
        self._trees: dict[int, tuple[StopTree, IntArray, IntArray]] = {}

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use."""
        trees = (array for tree, _, _ in self._trees.values() for array in tree)
        return sum(array.nbytes for array in (*self._blocks, *trees))

    def _tree(self, stop: np.uint8) -> tuple[StopTree, IntArray, IntArray]:
        """Made when it is first asked for."""
        if int(stop) not in self._trees:
            self._trees[int(stop)] = plant(self._blocks, stop)
        return self._trees[int(stop)]

    def cast(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        max_range: float,
        *,
        until: Until = "occupied",
        threads: int = 1,
    ) -> RayHits:
        """The first cell that ends each ray: arguments and errors as in `Queries.cast_rays`."""
        check_numbers(max_range=max_range)
        if not max_range > 0.0:
            raise ConfigError(f"max_range is a length above 0 [m], got {max_range}")
        check_threads(threads)
        start, way = rays_in(self, self._frame, origins, directions)
        place = start / self.resolution
        walk = self.walker(until)
        distance, cell, ended = (
            np.empty(len(way)),
            np.empty_like(way, np.int64),
            np.empty(len(way), np.uint8),
        )

        def fill(part: slice) -> None:
            distance[part], cell[part], ended[part] = walk(
                place[part], way[part], max_range / self.resolution
            )

        parts = [slice(first, first + _BATCH) for first in range(0, len(way), _BATCH)]
        if threads == 1:
            for part in parts:
                fill(part)
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(fill, parts))
        states = np.full(256, RayHits.MAX_RANGE, np.int8)
        for state in State:
            states[bit_of(state)] = state
        return RayHits(distance * self.resolution, cell, states[ended])

    def walker(self, until: Until) -> Walker:
        """Rays that nothing is checked of: what batches of them go through.

        Args:
            until: as in `cast`.

        Returns:
            A function of starts [cells], directions, shape (n, d) each, and reach [cells] that
            gives the distance [cells], the cell and the bit of its state as `RayHits` have them.

        Raises:
            ConfigError: until names no state.
        """
        stop, d = _bits(until), self.ndim
        tree, lo, hi = self._tree(stop)

        def walk(
            starts: FloatArray, ways: FloatArray, reach: float
        ) -> tuple[FloatArray, IntArray, npt.NDArray[np.uint8]]:
            distance = np.full(len(ways), math.inf)
            cell = np.full(ways.shape, RayHits.NO_CELL)
            ended = np.zeros(len(ways), np.uint8)
            walk_rays(
                self._blocks, tree, SIDE_BITS[d], lo, hi, starts, ways, reach, stop,
                np.empty(d, np.int64), distance, cell, ended,
            )  # fmt: skip
            return distance, cell, ended

        return walk


def rays_in(
    grid: CellGrid, frame: Frame | None, origins: npt.ArrayLike, directions: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Rays in the frame that cells count from.

    Args:
        grid: the map.
        frame: map_from_grid; None: the map frame.
        origins: in the map frame [m], shape (n, d), or (d,), one for all.
        directions: of length 1, shape (n, d).

    Returns:
        Origins [m] and directions, shape (n, d) each, contiguous.

    Raises:
        InputError: as `Queries.cast_rays` says.
    """
    way = _unit(points_in(directions, grid.ndim, "directions"))
    start = np.asarray(origins)
    start = points_in(start[None] if start.ndim == 1 else start, grid.ndim, "origins")
    if len(start) == 1:
        start = np.broadcast_to(start, way.shape)
    if len(start) != len(way):
        raise InputError(
            f"rays need one origin each or one for all, got {len(start)} origins and "
            f"{len(way)} directions"
        )
    if frame is not None:
        turn, corner = frame  # rows from the right: by the inverse
        start, way = (start - corner) @ turn, way @ turn
    check_places(start / grid.resolution)
    return np.ascontiguousarray(start), np.ascontiguousarray(way)


def _bits(until: Until) -> np.uint8:
    names = (until,) if isinstance(until, str) else tuple(until)
    if not names or not set(names) <= set(get_args(StateName)):
        known = ", ".join(get_args(StateName))
        raise ConfigError(f"rays go on until a cell is one or several of {known}; got {until!r}")
    return np.uint8(sum(bit_of(State[name.upper()]) for name in set(names)))


def _unit(directions: FloatArray) -> FloatArray:
    length = np.linalg.norm(directions, axis=1)
    wrong = ~(np.abs(length - 1.0) <= _UNIT)
    if wrong.any():
        first = int(np.argmax(wrong))
        raise InputError(
            f"{np.count_nonzero(wrong)} of {len(length)} directions are not of length 1, the first "
            f"is direction {first}, of length {length[first]:.9g}: divide them by their length"
        )
    return directions
