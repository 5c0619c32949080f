# SPDX-License-Identifier: Apache-2.0
"""The Ising prior in a map that grows: where messages go to neighbours, and how often."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.forward.cell_grid import CellField

__all__ = ["settle_new_blocks", "tell_neighbours"]

# Passes over new blocks, at most: under a coupling near the critical one messages creep.
_MAX_PASSES = 40


def settle_new_blocks(field: CellField, first: int, coupling: float, tolerance: float) -> None:
    """Pass messages between the cells of new blocks until they rest.

    Under a strong coupling unseen cells come to agree that they are free. Without it the first beam
    that meets them would find hundreds of cells of about 1/2 in its cone, and a long free one would
    look like a dropout.

    Args:
        field: the cells, changed in place.
        first: number of the first new block.
        coupling: strength J.
        tolerance: messages rest where they change by less on average [nats].
    """
    from oddsmap.kernels.infer.beam_factor import NAT

    new = np.arange(first, len(field.coords), dtype=np.int32)
    if len(new) == 0 or coupling == 0.0:
        return
    count = len(new) * field.block_cells * 2 * field.ndim
    for _ in range(_MAX_PASSES):
        if _pass(field, new, coupling) / NAT / count < tolerance:
            break


def tell_neighbours(field: CellField, blocks: npt.NDArray[np.int32], coupling: float) -> None:
    """Renew the messages that the cells of some blocks send to their neighbours, once.

    Args:
        field: the cells, changed in place.
        blocks: numbers of the blocks whose beliefs have changed.
        coupling: strength J.
    """
    if coupling > 0.0:
        _pass(field, blocks, coupling)


def _pass(field: CellField, blocks: npt.NDArray[np.int32], coupling: float) -> int:
    from oddsmap.kernels.infer.ising import pass_from_blocks

    return pass_from_blocks(
        blocks, field.block_neighbours(), field.side, field.ndim, coupling,
        field.belief, field.received,
    )  # fmt: skip
