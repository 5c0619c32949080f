# SPDX-License-Identifier: Apache-2.0
"""Messages between neighbouring cells: a weak prior that cells are like their neighbours.

The prior is exp(J [m_i = m_j]) on each pair that shares a side. With x the belief of j without
the message from i,

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
def _message(x: float, strength: float) -> float:
    # Stable for any x: divide both terms by the larger one.
    if x > 0:
        e = math.exp(-x)
        return math.log((math.exp(strength) + e) / (1.0 + e * math.exp(strength)))
    e = math.exp(x)
    return math.log((math.exp(strength) * e + 1.0) / (e + math.exp(strength)))


@inlined
def _send_around(
    block: int,
    neighbours: npt.NDArray[np.int32],
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
                    other = neighbours[block, way]
                    if other < 0:
                        continue
                    i = other * cells + place - step * (side - 1)
                # The message from i to j on this side is not sent back.
                x = (belief[j] - messages[j, way]) / NAT
                back = way ^ 1
                new = np.int64(np.rint(_message(x, strength) * NAT))
                change = new - messages[i, back]
                belief[i] += change
                messages[i, back] = np.int32(new)
                moved += abs(change)
            span *= side
    return moved


@kernel
def pass_to_neighbours(
    neighbours: npt.NDArray[np.int32],
    side: int,
    d: int,
    strength: float,
    belief: IntArray,
    messages: npt.NDArray[np.int32],
) -> int:
    """Renew all messages between neighbours once, block by block, cell by cell.

    Args:
        neighbours: number of the block on each side of a block, or -1, shape (blocks, 2 d): below
            and above along x, then y, then z.
        side: cells along a block's side.
        d: dimensions.
        strength: J.
        belief: log odds of each cell [1 / NAT], block after block, x fastest; changed in place.
        messages: what each cell received from its neighbour on each side, shape (cells, 2 d).

    Returns:
        The sum of the messages' changes, in size [1 / NAT].
    """
    moved = np.int64(0)
    for block in range(neighbours.shape[0]):
        moved += _send_around(block, neighbours, side, d, strength, belief, messages)
    return moved


@kernel
def pass_from_blocks(
    blocks: npt.NDArray[np.integer],
    neighbours: npt.NDArray[np.int32],
    side: int,
    d: int,
    strength: float,
    belief: IntArray,
    messages: npt.NDArray[np.int32],
) -> int:
    """Renew the messages that the cells of some blocks send to their neighbours, in any block.

    Args:
        blocks: numbers of the blocks, in turn.
        neighbours: and the others as in `pass_to_neighbours`.
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
        moved += _send_around(blocks[n], neighbours, side, d, strength, belief, messages)
    return moved
