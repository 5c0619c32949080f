# SPDX-License-Identifier: Apache-2.0
"""Memory for the blocks of a window, made when a block is first touched."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import inlined

__all__ = ["slot_of"]


@inlined
def slot_of(
    block: np.uint64, table: npt.NDArray[np.int32], used: npt.NDArray[np.int64]
) -> np.uint64:
    """The slot of a block; the next free one where it has none.

    Args:
        block: its place in the window.
        table: slots from 1 in the order of first touch, 0 where a block is not touched yet.
        used: used[0] is how many blocks were touched; then their places in the table.
    """
    slot = np.uint64(table[block])
    if slot == 0:
        used[0] += 1
        slot = np.uint64(used[0])
        table[block] = np.int32(slot)
        used[slot] = np.int64(block)
    return slot
