# SPDX-License-Identifier: Apache-2.0
"""Marks of the cells of tiles by their whole votes, written into a box."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing

__all__ = ["mark_tiles"]

IntArray = npt.NDArray[np.int64]
Mask = npt.NDArray[np.uint8]


@borrowing
def mark_tiles(
    narrow: Mask,
    coords: IntArray,
    slots: IntArray,
    side: int,
    marks: Mask,
    lo: IntArray,
    hi: IntArray,
    mask: Mask,
) -> None:
    """Write the marks of those cells of tiles that lie in a box.

    Args:
        narrow: whole votes, see `TileArrays`: shape (capacity, 2, cells of a tile).
        coords: coordinates of each tile, shape (capacity, d), x first.
        slots: tiles without further votes.
        side: cells along a tile's side.
        marks: by votes, hits * 256 + passes, shape (65536,).
        lo: first cell of the box, shape (d,), x first.
        hi: past its last.
        mask: the marks of its cells, x fastest, shape (all of them,).
    """
    d = coords.shape[1]
    layers = side if d == 3 else 1
    width = hi[0] - lo[0]
    for i in range(slots.shape[0]):
        slot = slots[i]
        hits, passes = narrow[slot, 0], narrow[slot, 1]
        x = coords[slot, 0] * side
        left, right = max(lo[0] - x, 0), min(hi[0] - x, side)
        for k in range(layers):
            layer = 0
            if d == 3:
                z = coords[slot, 2] * side + k
                if (z < lo[2]) | (z >= hi[2]):
                    continue
                layer = z - lo[2]
            for j in range(side):
                y = coords[slot, 1] * side + j
                if (y < lo[1]) | (y >= hi[1]):
                    continue
                place = (layer * (hi[1] - lo[1]) + y - lo[1]) * width + x - lo[0]
                cell = (k * side + j) * side
                for c in range(left, right):
                    votes = np.int64(hits[cell + c]) * 256 + np.int64(passes[cell + c])
                    mask[place + c] = marks[votes]
