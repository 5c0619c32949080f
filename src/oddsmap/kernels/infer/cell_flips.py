# SPDX-License-Identifier: Apache-2.0
"""One map at a time: each cell free or occupied, turned over one by one.

The binary relatives of `beam_factor.py`. A cell's odds given all others take O(1) for each beam
that meets it (`incremental_likelihood.py`); when it is turned over, the bins of its beams are gone
through again. The sums are computed again each time, so that nothing drifts. Gibbs sampling draws
each cell given all others; hill climbing takes what is more probable.

Source: Geman and Geman, Stochastic relaxation (1984); Besag, On the statistical analysis of dirty
pictures (1986); the beams' part is derived in docs/method/full-map.md.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.infer.beam_factor import BeamRows
from oddsmap.kernels.infer.incremental_likelihood import (
    BeamBins,
    CellRows,
    chance_of,
    quiet,
    renew,
    silence,
)
from oddsmap.kernels.jit import inlined, kernel

__all__ = ["climb_sweep", "conditional", "flip", "gibbs_sweep", "with_beams"]

FloatArray = npt.NDArray[np.float64]
State = npt.NDArray[np.uint8]

# Odds this near to 0 are a draw: rounding must not turn a cell over and back forever.
_DRAW = 1e-9


@inlined
def with_beams(
    total: float, bins: BeamBins, of_cells: CellRows, detection: FloatArray, state: State, cell: int
) -> float:
    """Log odds of one cell given all others, `total` being what the prior makes of it."""
    chance = chance_of(detection, cell)
    # Ratios are multiplied, so that few logarithms are needed.
    odds = 1.0
    for i in range(of_cells.offsets[cell], of_cells.offsets[cell + 1]):
        k = of_cells.bins[i]
        d = chance * of_cells.fractions[i]
        part = bins.gain[k] / quiet(d, state[cell])
        # 1e-300: a reading that no map of these two explains says nothing about the cell.
        ratio = max(bins.base[k] + part * (1.0 - d), 1e-300) / max(bins.base[k] + part, 1e-300)
        odds *= min(max(ratio, 1e-200), 1e200)
        if odds < 1e-100 or odds > 1e100:
            total += math.log(odds)
            odds = 1.0
    return total + math.log(odds)


@inlined
def flip(
    rows: BeamRows,
    bins: BeamBins,
    of_cells: CellRows,
    detection: FloatArray,
    state: State,
    cell: int,
) -> None:
    """Turn one cell over, and renew the bins of its beams."""
    state[cell] = 1 - state[cell]
    for i in range(of_cells.offsets[cell], of_cells.offsets[cell + 1]):
        k = of_cells.bins[i]
        bins.silent[k] = silence(rows, bins, detection, state, k)
        renew(bins, bins.beams[k])


@inlined
def _log_odds(
    bins: BeamBins,
    of_cells: CellRows,
    detection: FloatArray,
    neighbours: npt.NDArray[np.int32],
    field: FloatArray,
    strength: float,
    state: State,
    cell: int,
) -> float:
    # Of one cell given all others.
    total = field[cell if field.shape[0] > 1 else 0]
    for way in range(neighbours.shape[1]):
        other = neighbours[cell, way]
        if other >= 0:
            total += strength * (2.0 * state[other] - 1.0)
    return with_beams(total, bins, of_cells, detection, state, cell)


@kernel
def conditional(
    bins: BeamBins,
    of_cells: CellRows,
    detection: FloatArray,
    neighbours: npt.NDArray[np.int32],
    field: FloatArray,
    strength: float,
    state: State,
    out: FloatArray,
) -> None:
    """Log odds of each cell given all others.

    Args:
        bins: as `renew_all` leaves them.
        of_cells: as `turn_rows` leaves them.
        detection: see `renew_all`.
        neighbours: numbers of each cell's neighbours, -1 where there is none, shape (cells, 2 d).
        field: log odds of the prior without neighbours, for each cell or one for all, shape (1,).
        strength: J of the prior exp(J [m_i = m_j]) on pairs of neighbours.
        state: 1 where a cell is occupied, shape (cells,).
        out: takes the log odds, shape (cells,).
    """
    for cell in range(state.shape[0]):
        out[cell] = _log_odds(bins, of_cells, detection, neighbours, field, strength, state, cell)


@kernel
def gibbs_sweep(
    rows: BeamRows,
    bins: BeamBins,
    of_cells: CellRows,
    detection: FloatArray,
    neighbours: npt.NDArray[np.int32],
    field: FloatArray,
    strength: float,
    uniform: FloatArray,
    state: State,
    total: FloatArray,
) -> int:
    """Draw each cell once, in order of their numbers, given all others.

    Args:
        rows: the beams.
        bins: and the next five as in `conditional`; the bins are changed with the map.
        of_cells: see there.
        detection: see there.
        neighbours: see there.
        field: see there.
        strength: see there.
        uniform: numbers drawn from [0, 1), shape (cells,).
        state: the map, changed in place.
        total: the conditional probabilities are added to it, shape (cells,).

    Returns:
        How many cells were turned over.
    """
    flips = 0
    for cell in range(state.shape[0]):
        odds = _log_odds(bins, of_cells, detection, neighbours, field, strength, state, cell)
        p = 1.0 / (1.0 + math.exp(-odds))
        total[cell] += p
        if (uniform[cell] < p) != (state[cell] == 1):
            flip(rows, bins, of_cells, detection, state, cell)
            flips += 1
    return flips


@kernel
def climb_sweep(
    rows: BeamRows,
    bins: BeamBins,
    of_cells: CellRows,
    detection: FloatArray,
    neighbours: npt.NDArray[np.int32],
    field: FloatArray,
    strength: float,
    state: State,
) -> int:
    """Turn over each cell whose other state is more probable, given all others.

    Arguments as in `gibbs_sweep`. No step lowers the posterior of the map.

    Returns:
        How many cells were turned over; 0: no single one could raise the posterior.
    """
    flips = 0
    for cell in range(state.shape[0]):
        odds = _log_odds(bins, of_cells, detection, neighbours, field, strength, state, cell)
        if (odds < -_DRAW) if state[cell] == 1 else (odds > _DRAW):
            flip(rows, bins, of_cells, detection, state, cell)
            flips += 1
    return flips
