# SPDX-License-Identifier: Apache-2.0
"""Messages between neighbouring cells: a weak prior that cells are like their neighbours.

The prior is exp(J [m_i = m_j]) on each pair that shares a side. With x the belief of j without
what i told it,

    lambda_{j -> i} = log (e^J e^x + 1) / (e^x + e^J),

the same exact integers as the beams' messages (`beam_factor.py`).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.infer.beam_factor import NAT
from oddsmap.kernels.jit import inlined, kernel

__all__ = ["pass_from_blocks", "pass_to_neighbours"]

IntArray = npt.NDArray[np.int64]


@inlined
def _told(x: float, strength: float) -> float:
    # Stable for any x: divide both terms by the larger one.
    if x > 0:
        e = math.exp(-x)
        return math.log((math.exp(strength) + e) / (1.0 + e * math.exp(strength)))
    e = math.exp(x)
    return math.log((math.exp(strength) * e + 1.0) / (e + math.exp(strength)))


@inlined
def _tell_around(
    block: int,
    beside: npt.NDArray[np.int32],
    side: int,
    d: int,
    strength: float,
    belief: IntArray,
    messages: npt.NDArray[np.int32],
) -> int:
    # Each cell of a block tells each of its neighbours; returns the sum of the changes.
    cells = side**d
    moved = np.int64(0)
    for place in range(cells):
        j = block * cells + place
        span = 1
        for axis in range(d):
            at = (place // span) % side
            for up in range(2):
                way = 2 * axis + up
                if up == 0:
                    inside, step = at > 0, -span
                else:
                    inside, step = at < side - 1, span
                if inside:
                    i = j + step
                else:
                    other = beside[block, way]
                    if other < 0:
                        continue
                    i = other * cells + place - step * (side - 1)
                # What i told j on this side is not told back to it.
                x = (belief[j] - messages[j, way]) / NAT
                back = way ^ 1
                new = np.int64(np.rint(_told(x, strength) * NAT))
                change = new - messages[i, back]
                belief[i] += change
                messages[i, back] = np.int32(new)
                moved += abs(change)
            span *= side
    return moved


@kernel
def pass_to_neighbours(
    beside: npt.NDArray[np.int32],
    side: int,
    d: int,
    strength: float,
    belief: IntArray,
    messages: npt.NDArray[np.int32],
) -> int:
    """Renew all messages between neighbours once, block by block, cell by cell.

    Args:
        beside: number of the block on each side of a block, or -1, shape (blocks, 2 d): below and
            above along x, then y, then z.
        side: cells along a block's side.
        d: dimensions.
        strength: J.
        belief: log odds of each cell [1 / NAT], block after block, x fastest; changed in place.
        messages: what each cell was told by its neighbour on each side, shape (cells, 2 d).

    Returns:
        The sum of the messages' changes, in size [1 / NAT].
    """
    moved = np.int64(0)
    for block in range(beside.shape[0]):
        moved += _tell_around(block, beside, side, d, strength, belief, messages)
    return moved


@kernel
def pass_from_blocks(
    blocks: npt.NDArray[np.integer],
    beside: npt.NDArray[np.int32],
    side: int,
    d: int,
    strength: float,
    belief: IntArray,
    messages: npt.NDArray[np.int32],
) -> int:
    """Renew the messages that the cells of some blocks tell their neighbours, in any block.

    Args:
        blocks: numbers of the blocks, in turn.
        beside: and the others as in `pass_to_neighbours`.
        side: see there.
        d: see there.
        strength: see there.
        belief: see there.
        messages: see there.

    Returns:
        The sum of the messages' changes, in size [1 / NAT].
    """
    moved = np.int64(0)
    for n in range(blocks.shape[0]):
        moved += _tell_around(blocks[n], beside, side, d, strength, belief, messages)
    return moved
