# SPDX-License-Identifier: Apache-2.0
"""Gibbs sampling of a map under a prior on its 3 x 3 windows.

The sibling of `cell_flips.py`, with which it shares the beams' part. The number of the window
around each cell is kept, so that the prior of a cell takes nine look-ups, and a flip nine bits.

Source: Geman and Geman, Stochastic relaxation (1984).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.infer.beam_factor import BeamRows
from oddsmap.kernels.infer.cell_flips import flip, with_beams
from oddsmap.kernels.infer.incremental_likelihood import BeamBins, CellRows
from oddsmap.kernels.jit import kernel

__all__ = ["WindowRows", "draw_windows"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
State = npt.NDArray[np.uint8]


class WindowRows(NamedTuple):
    """The cells that are drawn, and the windows that each is in."""

    cells: npt.NDArray[np.int32]
    """Numbers of the cells, shape (n,)."""
    around: npt.NDArray[np.int32]
    """Numbers of the 3 x 3 cells around each, row by row: the middles of its windows, (n, 9)."""
    steps: FloatArray
    """What a window's log factor gains if the cell in place 8 - k is occupied, shape (9, 512)."""
    codes: npt.NDArray[np.uint16]
    """Number of the window around each cell of the map, changed with it, shape (cells,)."""


@kernel
def draw_windows(
    rows: BeamRows,
    bins: BeamBins,
    of_cells: CellRows,
    detection: FloatArray,
    windows: WindowRows,
    chosen: IntArray,
    uniform: FloatArray,
    state: State,
    probability: FloatArray,
) -> int:
    """Draw some cells once, one after the other, given all others.

    Args:
        rows: the beams.
        bins: as `renew_all` leaves them, changed with the map.
        of_cells: as `turn_rows` leaves them.
        detection: see `renew_all`.
        windows: the prior; the windows' numbers are changed with the map.
        chosen: places in `windows.cells`, in the order of drawing, shape (m,).
        uniform: numbers drawn from [0, 1), shape (m,).
        state: the map, changed in place, shape (cells,).
        probability: takes each one's conditional probability, shape (n,); others' stay.

    Returns:
        How many cells were turned over.
    """
    flips = 0
    for turn in range(chosen.shape[0]):
        at = chosen[turn]
        cell = windows.cells[at]
        odds = 0.0
        for k in range(9):
            odds += windows.steps[k, windows.codes[windows.around[at, k]]]
        odds = with_beams(odds, bins, of_cells, detection, state, cell)
        p = 1.0 / (1.0 + math.exp(-odds))
        probability[at] = p
        if (uniform[turn] < p) != (state[cell] == 1):
            flip(rows, bins, of_cells, detection, state, cell)
            for k in range(9):
                windows.codes[windows.around[at, k]] ^= np.uint16(1 << (8 - k))
            flips += 1
    return flips
