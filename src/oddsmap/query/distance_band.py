# SPDX-License-Identifier: Apache-2.0
"""Distances near obstacles alone: memory goes with the obstacles, not with the size of the map."""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.cell_index import cell_indices
from oddsmap.errors import ConfigError, MapTooLargeError
from oddsmap.kernels.query.distances import mark_cells
from oddsmap.limits import memory_limit
from oddsmap.query.boxes import Box
from oddsmap.query.given_numbers import check_numbers, check_threads
from oddsmap.query.obstacles import Obstacles, View
from oddsmap.query.places import Framed
from oddsmap.query.squared_distances import Squared, none_of, squared_to
from oddsmap.short_repr import described, in_bytes

__all__ = ["DistanceBand"]

_SIDE = {2: 32, 3: 16}
"""Cells along the side of a block, which is kept if it has a distance."""
_TOGETHER = 4
"""Blocks along each axis worked out together: what lies around them is read once for all."""
_MOST_TOGETHER = {2: 64, 3: 8}
"""More of them where distances are large, or what is read around them is most of the work: a band
of 100 m in the Intel map (0.05 m) takes 1.4 s of CPU instead of the 41 s of groups of 4."""
_MOST_CELLS = 2048
"""The largest distance: beyond, what lies around a few blocks would fill the memory."""

_NONE = none_of(np.int32)
_Row = tuple[int, ...]


class DistanceBand(Framed):
    """Distances of the cells within `max_distance` of an obstacle; all others are farther.

    They are those of a `DistanceField` with the same `max_distance`, in blocks where there are any.
    Made by `distance_band` of a view; what is added to the map later does not show.

    Attributes:
        ndim: 2 or 3.
        resolution: side of a cell [m].
        max_distance: the largest distance [m].
        signed: whether obstacles have distances below 0.
        map_from_cells: where cells count from, if not from the map frame: rotation, translation.
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield f"{self.ndim}D"
        yield f"cells of {self.resolution:g} m"
        yield "signed" if self.signed else "unsigned"
        yield f"up to {self.max_distance:g} m"
        yield in_bytes(self.nbytes)

    def __init__(
        self, view: View, *, max_distance: float, obstacles: Obstacles, signed: bool, threads: int
    ) -> None:
        check_numbers(max_distance=max_distance)
        if not 0.0 < max_distance <= _MOST_CELLS * view.resolution:
            raise ConfigError(
                f"max_distance of a band is above 0 and at most {_MOST_CELLS} cells, "
                f"{_MOST_CELLS * view.resolution:g} m here; got {max_distance}"
            )
        check_threads(threads)
        if obstacles.outside:
            raise ConfigError(
                "unknown cells are everywhere, and a band around them has no end: leave "
                '"unknown" out, or ask a distance_field of a box'
            )
        self.ndim, self.resolution = view.ndim, view.resolution
        self.max_distance, self.signed = float(max_distance), signed
        self.map_from_cells = view._map_from_cells()
        self._side = _SIDE[view.ndim]
        cells = max_distance / view.resolution
        self._reach = math.floor(cells * cells * (1.0 + 1e-12))
        near = _ByBlock(obstacles.cells(view), self._side)
        # Where a distance may be: around the blocks that have an obstacle.
        blocks = math.isqrt(self._reach) // self._side + 1
        groups = near.around(blocks, max(_TOGETHER, min(blocks, _MOST_TOGETHER[view.ndim])))
        boxes = [groups[key] for key in sorted(groups)]
        self._check_room(sum(box.size for box in boxes) * self._side**self.ndim)

        def made(blocks: Box) -> list[tuple[_Row, Squared]]:
            return list(self._blocks_of(blocks, near))

        if threads == 1:
            found = [block for blocks in boxes for block in made(blocks)]
        else:
            with ThreadPoolExecutor(threads) as pool:
                found = [block for each in pool.map(made, boxes) for block in each]
        self._slots = {row: slot for slot, (row, _) in enumerate(found)}
        shape = (self._side,) * self.ndim
        self._squared = np.stack([np.zeros(shape, np.int32), *(block for _, block in found)])[1:]

    def _check_room(self, cells: int) -> None:
        # At worst all of them are kept, twice while they are put together.
        needed, limit = cells * 8, memory_limit()
        if needed > limit:
            raise MapTooLargeError(
                f"a band of {self.max_distance:g} m around the obstacles may need "
                f"{needed / 1e9:.3g} GB, more than the {limit / 1e9:.1f} GB that may be used here: "
                "give a smaller max_distance, or ask a distance_field of a box"
            )

    def _blocks_of(self, blocks: Box, near: _ByBlock) -> Iterator[tuple[_Row, Squared]]:
        """Those of some blocks that have a distance."""
        box = Box(blocks.lo * self._side, blocks.hi * self._side)
        read = box.wider(math.isqrt(self._reach) + 1)
        mask = near.mask(read)
        found = squared_to(mask, read, box, self._reach, np.int32, 1)
        if self.signed:
            inside = squared_to(1 - mask, read, box, self._reach, np.int32, 1)
            np.subtract(found, inside, out=found)  # one of the two is 0
        for step in np.ndindex(*blocks.shape):
            part = found[tuple(slice(n * self._side, (n + 1) * self._side) for n in step)]
            if (part != _NONE).any():  # deep in an obstacle it is -_NONE
                yield tuple((blocks.lo + step[::-1]).tolist()), part.copy()

    @property
    def nbytes(self) -> int:
        """Bytes of the distances."""
        return int(self._squared.nbytes)

    def at(self, points: npt.ArrayLike) -> FloatArray:
        """Distances at points, those of the cells that hold them.

        Args:
            points: in the map frame [m], shape (n, d), x first.

        Returns:
            Distances [m], shape (n,); infinite beyond `max_distance`.

        Raises:
            InputError: another shape, or coordinates that are not finite or farther than 2^46 cells
                from the map's origin.
        """
        return self._at(self.cell_of(points))

    def at_cells(self, cells: npt.ArrayLike) -> FloatArray:
        """As `at`, of cells: shape (n, d), x first, whole numbers."""
        return self._at(cell_indices(cells, self.ndim))

    def cells(self) -> tuple[IntArray, FloatArray]:
        """The cells within `max_distance` of an obstacle, block by block.

        Returns:
            index, shape (n, d), x first; distances [m], shape (n,).
        """
        rows = np.array(list(self._slots), np.int64).reshape(-1, self.ndim)
        place = np.argwhere(np.abs(self._squared) != _NONE)
        index = rows[place[:, 0]] * self._side + place[:, :0:-1]
        return index, self._in_metres(self._squared[tuple(place.T)])

    def _at(self, cells: IntArray) -> FloatArray:
        found = np.full(len(cells), _NONE, np.int32)
        if len(cells) and self._slots:
            rows, which = np.unique(cells // self._side, axis=0, return_inverse=True)
            slots = np.array([self._slots.get(tuple(row), -1) for row in rows.tolist()])
            slot = slots[which.ravel()]
            there = slot >= 0
            place = (cells[there] % self._side).T[::-1]
            found[there] = self._squared[(slot[there], *place)]
        return self._in_metres(found)

    def _in_metres(self, squared: Squared) -> FloatArray:
        size = np.abs(squared).astype(np.float64)
        size[size == _NONE] = np.inf
        root: FloatArray = np.sqrt(size) * self.resolution
        return np.copysign(root, squared, out=root) if self.signed else root


class _ByBlock:
    """Cells, in the order of the blocks that hold them."""

    def __init__(self, cells: IntArray, side: int) -> None:
        self._side, self._ndim = side, cells.shape[1]
        rows = cells // side
        order = np.lexsort(rows.T)
        self._cells, rows = np.ascontiguousarray(cells[order]), rows[order]
        new = np.ones(len(rows), np.bool_)
        new[1:] = (rows[1:] != rows[:-1]).any(axis=1)
        start = np.flatnonzero(new)
        self._rows = rows[start]
        past = np.append(start, len(rows))[1:]
        self._parts = {
            tuple(row): (a, b)
            for row, a, b in zip(self._rows.tolist(), start.tolist(), past.tolist(), strict=True)
        }

    def around(self, blocks: int, together: int) -> dict[_Row, Box]:
        """Groups of blocks, and in each the box of those so near to a block with cells."""
        found: dict[_Row, Box] = {}
        near, far = self._rows - blocks, self._rows + blocks + 1
        for lo, hi in zip(near, far, strict=True):
            first, last = lo // together, -(-hi // together)
            for step in np.ndindex(*(last - first).tolist()):
                group = first + step
                part = Box(group * together, (group + 1) * together).meet(Box(lo, hi))
                key = tuple(group.tolist())
                found[key] = part if key not in found else found[key].hull(part)
        return found

    def mask(self, box: Box) -> npt.NDArray[np.uint8]:
        """1 for the cells of a box."""
        mask = np.zeros(box.shape, np.uint8)
        lo, hi = box.lo // self._side, -(-box.hi // self._side)
        for step in np.ndindex(*(hi - lo).tolist()):
            part = self._parts.get(tuple((lo + step).tolist()))
            if part is not None:
                cells = self._cells[part[0] : part[1]]
                ones = np.ones(len(cells), np.uint8)
                mark_cells(cells, ones, box.lo, box.hi, mask.reshape(-1))
        return mask
