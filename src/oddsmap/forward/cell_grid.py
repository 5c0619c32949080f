# SPDX-License-Identifier: Apache-2.0
"""The cells that beams are about, numbered: sparse 2D or 3D blocks.

What is known about the cells (beliefs, messages between neighbours) lies in arrays of one row per
cell, block after block, x fastest within a block.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import MapTooLargeError

__all__ = ["CellField", "Window", "windows_of"]


# The same as an evidence map's tiles.
_SIDE = {2: 32, 3: 8}
# Cells have numbers of 31 bits.
_MAX_CELLS = (1 << 31) - 1
# A window's table has 4 bytes per block; of more cells than this a beam is too long by mistake.
_MAX_BLOCKS = 1 << 28


class CellField:
    """Numbers for the cells of the blocks in use, and arrays that grow with them.

    Args:
        ndim: 2 or 3.
        start: belief of a cell before any message [1 / NAT].

    Attributes:
        coords: coordinates of each block in blocks, shape (blocks, d), x first.
        belief: log odds of each cell [1 / NAT], shape (cells,).
        received: messages from a cell's neighbours [1 / NAT], shape (cells, 2 d).
        observed: LISTED or REACHED by beams, or 0, shape (cells,).

    The arrays may be others after `insert` or a window's `number`.
    """

    def __init__(self, ndim: int, start: int) -> None:
        self.ndim = ndim
        self.side = _SIDE[ndim]
        self.start = start
        self._number: dict[tuple[int, ...], int] = {}
        self._capacity: dict[str, npt.NDArray[Any]] = {
            "coords": np.empty((0, ndim), np.int64),
            "block_neighbours": np.empty((0, 2 * ndim), np.int32),
            "belief": np.empty(0, np.int64),
            "received": np.empty((0, 2 * ndim), np.int32),
            "observed": np.empty(0, np.uint8),
        }
        self._show()

    def __getstate__(self) -> dict[str, Any]:
        # What the used parts show must go along as one array with them: copied apart, later
        # messages would go into the one and growth would copy the other.
        used = ("ndim", "start", "coords", "belief", "received", "observed")
        return {name: getattr(self, name) for name in used}

    def __setstate__(self, state: dict[str, Any]) -> None:
        # A subclass with other arguments would be called wrongly: there is none.
        self.__init__(state["ndim"], state["start"])  # type: ignore[misc]
        self.insert(state["coords"])
        for name in ("belief", "received", "observed"):
            getattr(self, name)[:] = state[name]

    def _show(self) -> None:
        # The arrays are the used part of larger arrays that double, so that adding blocks one by
        # one takes time in proportion to their number.
        blocks = len(self._number)
        cells = blocks * self.block_cells
        self.coords: IntArray = self._capacity["coords"][:blocks]
        self._block_neighbours: npt.NDArray[np.int32] = self._capacity["block_neighbours"][:blocks]
        self.belief: IntArray = self._capacity["belief"][:cells]
        self.received: npt.NDArray[np.int32] = self._capacity["received"][:cells]
        self.observed: npt.NDArray[np.uint8] = self._capacity["observed"][:cells]

    @property
    def block_cells(self) -> int:
        """Cells of a block."""
        return int(self.side**self.ndim)

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use."""
        return self.belief.nbytes + self.received.nbytes + self.observed.nbytes + self.coords.nbytes

    def insert(self, coords: IntArray) -> npt.NDArray[np.int32]:
        """Numbers of blocks, made where they are new: coords (n, d) in, shape (n,) out.

        Raises:
            MapTooLargeError: more than 2^31 cells.
        """
        numbers = np.empty(len(coords), np.int32)
        new = []
        for i, key in enumerate(map(tuple, coords.tolist())):
            at = self._number.get(key)
            if at is None:
                at = self._number[key] = len(self._number)
                new.append(key)
            numbers[i] = at
        if len(self._number) * self.block_cells > _MAX_CELLS:
            raise MapTooLargeError(
                f"full-map estimation holds up to 2^31 cells, the beams reach "
                f"{len(self._number) * self.block_cells:.1e}: use a coarser resolution, or map a "
                "part of the log"
            )
        if new:
            self._grow(np.array(new, np.int64))
        return numbers

    def _grow(self, new: IntArray) -> None:
        before, blocks = len(self.coords), len(self._number)
        if blocks > len(self._capacity["coords"]):
            for name, array in self._capacity.items():
                rows = 1 if name in ("coords", "block_neighbours") else self.block_cells
                larger = np.empty((max(blocks, 2 * before) * rows, *array.shape[1:]), array.dtype)
                larger[: before * rows] = array[: before * rows]
                self._capacity[name] = larger
        self._show()
        first = before * self.block_cells
        self.coords[before:] = new
        self.belief[first:], self.received[first:], self.observed[first:] = self.start, 0, 0
        for way in range(2 * self.ndim):
            step = np.zeros(self.ndim, np.int64)
            step[way // 2] = 2 * (way % 2) - 1
            found = self.find(new + step)
            self._block_neighbours[before:, way] = found
            there = np.flatnonzero(found >= 0)
            self._block_neighbours[found[there], way ^ 1] = before + there

    def copy(self) -> CellField:
        """A field of its own, with the same numbers and values."""
        other = CellField.__new__(CellField)
        other.__setstate__(self.__getstate__())
        return other

    def find(self, coords: IntArray) -> npt.NDArray[np.int32]:
        """Numbers of blocks, -1 for those that are not in use."""
        keys = map(tuple, coords.tolist())
        return np.array([self._number.get(key, -1) for key in keys], np.int32)

    def block_neighbours(self) -> npt.NDArray[np.int32]:
        """Number of the block on each side of each block, or -1, shape (blocks, 2 d)."""
        return self._block_neighbours

    def neighbours(self) -> npt.NDArray[np.int32]:
        """Number of the cell on each side of each cell, or -1, shape (cells, 2 d).

        Below and above along x, then y, then z, as `block_neighbours` has it for blocks.
        """
        blocks = np.arange(len(self.coords)).reshape(-1, *(1,) * (self.ndim - 1))
        cells = np.arange(len(self.belief), dtype=np.int32)
        cells = cells.reshape(-1, *(self.side,) * self.ndim)
        found = np.empty((len(cells.ravel()), 2 * self.ndim), np.int32)
        for way in range(2 * self.ndim):
            axis, up = self.ndim - way // 2, way % 2
            # At a block's end it goes on in the next one, where it has begun in this one.
            near = np.roll(cells, -1 if up else 1, axis)
            end = np.moveaxis(near, axis, -1)[..., -1 if up else 0]
            near_blocks = self._block_neighbours[:, way].reshape(blocks.shape)
            end[...] = np.where(
                near_blocks >= 0, end + (near_blocks - blocks) * self.block_cells, -1
            )
            found[:, way] = near.ravel()
        return found

    def index(self, numbers: npt.NDArray[np.integer]) -> IntArray:
        """Indices of cells in the map, shape (n, d), x first."""
        block, place = np.divmod(numbers.astype(np.int64), self.block_cells)
        within = np.stack(np.unravel_index(place, (self.side,) * self.ndim)[::-1], axis=1)
        return np.asarray(self.coords[block] * self.side + within)


class Window:
    """A box of whole blocks around some beams, in which their cells are listed.

    Args:
        field: whose blocks the cells are of.
        lo: first cell that a beam may reach, shape (d,), x first.
        hi: past the last one, shape (d,).

    Raises:
        MapTooLargeError: the box has too many blocks.
    """

    def __init__(self, field: CellField, lo: IntArray, hi: IntArray) -> None:
        self._field = field
        first = lo // field.side
        self._first = first
        blocks = -(-hi // field.side) - first
        if np.prod(blocks.astype(np.float64)) > _MAX_BLOCKS:
            raise MapTooLargeError(
                f"the beams span {' x '.join(str(int(n)) for n in blocks * field.side)} cells: "
                "use a coarser resolution, or range_max where a reading is too long"
            )
        self.lo = first * field.side
        self.shape = blocks * field.side
        """Cells along each axis, x first."""
        self._blocks = blocks
        self._strides = np.concatenate([[1], np.cumprod(blocks[:-1])]).astype(np.int64)
        self._table = np.full(int(blocks.prod()), -1, np.int32)
        self._found = np.empty(len(self._table), np.int64)

    def number(self, places: npt.NDArray[np.signedinteger]) -> npt.NDArray[np.int32]:
        """Numbers of cells, given their places in the window (x fastest), shape (n,)."""
        from oddsmap.kernels.infer.block_numbering import find_blocks, number_cells

        side = self._field.side
        shape = (places, self.shape, side, self._strides, self._table)
        found = self._found[: find_blocks(*shape, self._found)]
        coords = np.stack(np.unravel_index(found, self._blocks[::-1])[::-1], axis=1) + self._first
        self._table[found] = self._field.insert(coords)
        numbers = np.empty(len(places), np.int32)
        number_cells(*shape, numbers)
        return numbers


def windows_of(
    field: CellField, origins: FloatArray, reach: float
) -> Iterator[tuple[slice, Window]]:
    """The windows that some beams need: a single one, but where a pose is far from the others.

    One pose that is off by thousands of kilometres would stretch a window over nothing.

    Args:
        field: whose blocks the cells are of.
        origins: where each beam starts [cells], shape (n, d), n > 0, x first.
        reach: how far beams go, at most [cells].

    Yields:
        Beams, in order, and their window.

    Raises:
        MapTooLargeError: the window of one pose has too many blocks.
    """
    pending = [slice(0, len(origins))]
    while pending:
        run = pending.pop()
        lowest, highest = origins[run].min(axis=0), origins[run].max(axis=0)
        lo, hi = np.floor(lowest - reach), np.ceil(highest + reach)
        blocks = np.prod(np.ceil(hi / field.side) - np.floor(lo / field.side))
        if blocks > _MAX_BLOCKS and (lowest < highest).any():
            middle = (run.start + run.stop) // 2
            pending += [slice(middle, run.stop), slice(run.start, middle)]
        else:
            yield run, Window(field, lo.astype(np.int64), hi.astype(np.int64))
