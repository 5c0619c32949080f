# SPDX-License-Identifier: Apache-2.0
"""Memory in which one 3D scan's votes are gathered before they go into tiles.

The window around a scan is a table of blocks; a block gets memory when it is first touched.
"""

from __future__ import annotations

import mmap
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.limits import TOO_LONG, memory_for

__all__ = ["BlockWindow"]

# Blocks that there is room for at first; it grows when a scan touches more.
_FIRST_BLOCKS = 1 << 10


class BlockWindow:
    """A table of blocks, and what was gathered in the cells of those that were touched.

    Args:
        channels: numbers per cell.
        kind: their type.
        bits: log2 of the side of a block.
    """

    def __init__(self, channels: int, kind: npt.DTypeLike, bits: int) -> None:
        self.table = np.zeros(0, np.int32)
        self.used = np.zeros(1, np.int64)
        self.cells: npt.NDArray[Any] = np.zeros((channels, 0), kind)
        self._bits = bits
        self.grow(_FIRST_BLOCKS)

    def open(self, blocks: int) -> None:
        """Make a table for a window of so many blocks.

        Raises:
            MapTooLargeError: memory does not hold it.
        """
        if len(self.table) < blocks:
            with _memory_for(blocks, 4 * blocks):
                self.table = _sparse_zeros(blocks)

    def grow(self, more: int) -> None:
        """Make room for twice as many blocks to be touched, and `more`.

        Raises:
            MapTooLargeError: memory does not hold them.
        """
        before = len(self.used)
        blocks = 2 * before + more
        cells = blocks << (3 * self._bits)
        channels = len(self.cells)
        # Only what was touched: the rest of what is held takes no memory yet, and shall not.
        touched = min((int(self.used[0]) + 1) << (3 * self._bits), self.cells.shape[1])
        with _memory_for(blocks, cells * channels * self.cells.itemsize):
            # np.zeros takes address space; memory only where a block is touched.
            used = np.zeros(blocks, np.int64)
            used[:before] = self.used
            grown = np.zeros((channels, cells), self.cells.dtype)
            grown[:, :touched] = self.cells[:, :touched]
        self.used, self.cells = used, grown


def _sparse_zeros(count: int) -> npt.NDArray[np.int32]:
    """Zeros of which a few are used here and there, and only these take memory.

    Not np.zeros: NumPy asks for huge pages, each of which is taken whole. With two threads that
    were 240 of 880 MB for ten scans that see 245 m at 0.05 m.
    """
    try:
        pages = mmap.mmap(-1, 4 * count, access=mmap.ACCESS_COPY)
    except OSError as error:
        raise MemoryError from error
    return np.frombuffer(pages, np.int32)


def _memory_for(blocks: int, size: int) -> AbstractContextManager[None]:
    return memory_for(f"the {blocks:.1e} blocks around one scan ({1e-9 * size:.1f} GB)", TOO_LONG)
