# SPDX-License-Identifier: Apache-2.0
"""Memory in which one 3D scan's votes are gathered before they go into tiles.

The window around a scan is a table of blocks; a block gets memory when it is first touched.
"""

from __future__ import annotations

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
                self.table = np.zeros(blocks, np.int32)

    def grow(self, more: int) -> None:
        """Make room for twice as many blocks to be touched, and `more`.

        Raises:
            MapTooLargeError: memory does not hold them.
        """
        before = len(self.used)
        blocks = 2 * before + more
        cells = blocks << (3 * self._bits)
        channels, held = self.cells.shape
        with _memory_for(blocks, cells * channels * self.cells.itemsize):
            # np.zeros takes address space; memory only where a block is touched.
            used = np.zeros(blocks, np.int64)
            used[:before] = self.used
            grown = np.zeros((channels, cells), self.cells.dtype)
            grown[:, :held] = self.cells
        self.used, self.cells = used, grown


def _memory_for(blocks: int, size: int) -> AbstractContextManager[None]:
    return memory_for(f"the {blocks:.1e} blocks around one scan ({1e-9 * size:.1f} GB)", TOO_LONG)
