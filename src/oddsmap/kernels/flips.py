# SPDX-License-Identifier: Apache-2.0
"""One map at a time: each cell free or occupied, turned over one by one.

The binary relatives of `beam_factor.py`, with q_i = m_i. For each range bin of a beam two numbers
are kept, from which a cell of that bin has its likelihoods in O(1):

    base = A_k + T_k L_k,  gain = T_k (B_k - L_k) Q_k,
    f(m_i) = base + gain / u_i * (1 - d_i m_i),  u_i = 1 - d_i m_i of the map as it is.

When a cell is turned over, the bins of its beams are gone through again. The sums are made anew
each time, so that nothing drifts. Gibbs sampling draws each cell given all others; hill climbing
takes what is more probable.

Source: Geman and Geman, Stochastic relaxation (1984); Besag, On the statistical analysis of dirty
pictures (1986), for both; the beams' part is derived in docs/method/full-map.md.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.beam_factor import BeamRows
from oddsmap.kernels.first_echo import Noise, given
from oddsmap.kernels.jit import inlined, kernel

__all__ = [
    "BeamBins",
    "CellRows",
    "climb_sweep",
    "conditional",
    "count_bins",
    "gibbs_sweep",
    "list_bins",
    "renew_all",
    "turn_rows",
]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
State = npt.NDArray[np.uint8]

# A cell that surely returns the beam and is occupied would leave nothing to divide by.
_LEAST_SILENT = 1e-12
# Odds this near to 0 are a draw: rounding must not turn a cell over and back for ever.
_DRAW = 1e-9


class BeamBins(NamedTuple):
    """The range bins that have cells, beam after beam, and what is kept of each."""

    offsets: IntArray
    """First bin of each beam and the end, shape (beams + 1,)."""
    rows: IntArray
    """First row of each bin and the end, shape (bins + 1,)."""
    beams: npt.NDArray[np.int32]
    """Beam of each bin, shape (bins,)."""
    given: FloatArray
    """L_k, shape (bins,)."""
    none: FloatArray
    """L_inf, shape (beams,)."""
    silent: FloatArray
    """Q_k, shape (bins,)."""
    base: FloatArray
    """A_k + T_k L_k, shape (bins,)."""
    gain: FloatArray
    """T_k (B_k - L_k) Q_k, shape (bins,)."""
    likelihood: FloatArray
    """p(z | m) of each beam, shape (beams,)."""


class CellRows(NamedTuple):
    """The rows again, cell after cell: where a cell is met by beams."""

    offsets: IntArray
    """Shape (cells + 1,)."""
    bins: npt.NDArray[np.int32]
    """Number of the bin that the cell lies in, for each beam that meets it, shape (rows,)."""
    fractions: npt.NDArray[np.float32]
    """Shape (rows,)."""


@kernel
def count_bins(rows: BeamRows) -> int:
    """How many range bins have cells, of all beams together."""
    count = 0
    for beam in range(rows.readings.shape[0]):
        begin, end = rows.offsets[beam], rows.offsets[beam + 1]
        for i in range(begin, end):
            if i == begin or rows.bins[i] != rows.bins[i - 1]:
                count += 1
    return count


@kernel
def list_bins(rows: BeamRows, noise: Noise, bins: BeamBins) -> None:
    """Fill in the first five arrays of `bins`.

    Args:
        rows: the beams.
        noise: what the sensor adds.
        bins: with room for `count_bins`.
    """
    count = 0
    for beam in range(rows.readings.shape[0]):
        begin, end = rows.offsets[beam], rows.offsets[beam + 1]
        reading = rows.readings[beam]
        bins.offsets[beam] = count
        bins.none[beam] = given(-1, reading, noise)
        for i in range(begin, end):
            if i == begin or rows.bins[i] != rows.bins[i - 1]:
                bins.rows[count] = i
                bins.beams[count] = beam
                bins.given[count] = given(np.int64(rows.bins[i]), reading, noise)
                count += 1
    bins.offsets[rows.readings.shape[0]] = count
    bins.rows[count] = rows.cells.shape[0]


@kernel
def turn_rows(rows: BeamRows, bins: BeamBins, of_cells: CellRows) -> None:
    """Sort the rows by cell, and by beam within a cell (counting sort).

    Args:
        rows: the beams.
        bins: as `list_bins` leaves them.
        of_cells: filled; its offsets say how many cells there are.
    """
    starts = of_cells.offsets
    starts[:] = 0
    for i in range(rows.cells.shape[0]):
        starts[rows.cells[i] + 1] += 1
    for cell in range(starts.shape[0] - 1):
        starts[cell + 1] += starts[cell]
    at = starts.copy()
    for k in range(bins.beams.shape[0]):
        for i in range(bins.rows[k], bins.rows[k + 1]):
            cell = rows.cells[i]
            to = at[cell]
            of_cells.bins[to] = k
            of_cells.fractions[to] = rows.fractions[i]
            at[cell] = to + 1


@inlined
def _quiet(chance: float, occupied: int) -> float:
    # u_i
    return max(1.0 - chance * occupied, _LEAST_SILENT)


@inlined
def _chance(detection: FloatArray, cell: int) -> float:
    return detection[cell if detection.shape[0] > 1 else 0]


@inlined
def _silence(
    rows: BeamRows, bins: BeamBins, detection: FloatArray, state: State, k: int
) -> float:
    # Q_k
    silent = 1.0
    for i in range(bins.rows[k], bins.rows[k + 1]):
        cell = rows.cells[i]
        silent *= _quiet(_chance(detection, cell) * rows.fractions[i], state[cell])
    return silent


@inlined
def _renew(bins: BeamBins, beam: int) -> None:
    # Forward and backward over one beam's bins, given Q_k.
    first, last = bins.offsets[beam], bins.offsets[beam + 1]
    through, before = 1.0, 0.0
    for k in range(first, last):
        bins.base[k] = before + through * bins.given[k]
        bins.gain[k] = through
        before += through * (1.0 - bins.silent[k]) * bins.given[k]
        through *= bins.silent[k]
    behind = bins.none[beam]
    bins.likelihood[beam] = before + through * behind
    for k in range(last - 1, first - 1, -1):
        bins.gain[k] *= (behind - bins.given[k]) * bins.silent[k]
        behind = (1.0 - bins.silent[k]) * bins.given[k] + bins.silent[k] * behind


@kernel
def renew_all(rows: BeamRows, bins: BeamBins, detection: FloatArray, state: State) -> None:
    """Fill in what `bins` keeps of a map.

    Args:
        rows: the beams.
        bins: as `list_bins` leaves them.
        detection: chance that an occupied cell wholly in the cone returns the beam, for each cell
            or one for all, shape (1,).
        state: 1 where a cell is occupied, shape (cells,).
    """
    for k in range(bins.beams.shape[0]):
        bins.silent[k] = _silence(rows, bins, detection, state, k)
    for beam in range(rows.readings.shape[0]):
        _renew(bins, beam)


@inlined
def _log_odds(
    bins: BeamBins,
    of_cells: CellRows,
    detection: FloatArray,
    beside: npt.NDArray[np.int32],
    field: FloatArray,
    strength: float,
    state: State,
    cell: int,
) -> float:
    # Of one cell given all others.
    total = field[cell if field.shape[0] > 1 else 0]
    for way in range(beside.shape[1]):
        other = beside[cell, way]
        if other >= 0:
            total += strength * (2.0 * state[other] - 1.0)
    chance = _chance(detection, cell)
    # The product of many ratios and few logarithms: a quarter of the time.
    odds = 1.0
    for i in range(of_cells.offsets[cell], of_cells.offsets[cell + 1]):
        k = of_cells.bins[i]
        d = chance * of_cells.fractions[i]
        part = bins.gain[k] / _quiet(d, state[cell])
        # 1e-300: a reading that no map of these two explains says nothing of the cell.
        ratio = max(bins.base[k] + part * (1.0 - d), 1e-300) / max(bins.base[k] + part, 1e-300)
        odds *= min(max(ratio, 1e-200), 1e200)
        if odds < 1e-100 or odds > 1e100:
            total += math.log(odds)
            odds = 1.0
    return total + math.log(odds)


@inlined
def _flip(
    rows: BeamRows,
    bins: BeamBins,
    of_cells: CellRows,
    detection: FloatArray,
    state: State,
    cell: int,
) -> None:
    state[cell] = 1 - state[cell]
    for i in range(of_cells.offsets[cell], of_cells.offsets[cell + 1]):
        k = of_cells.bins[i]
        bins.silent[k] = _silence(rows, bins, detection, state, k)
        _renew(bins, bins.beams[k])


@kernel
def conditional(
    bins: BeamBins,
    of_cells: CellRows,
    detection: FloatArray,
    beside: npt.NDArray[np.int32],
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
        beside: numbers of each cell's neighbours, -1 where there is none, shape (cells, 2 d).
        field: log odds of the prior without neighbours, for each cell or one for all, shape (1,).
        strength: J of the prior exp(J [m_i = m_j]) on pairs of neighbours.
        state: 1 where a cell is occupied, shape (cells,).
        out: takes the log odds, shape (cells,).
    """
    for cell in range(state.shape[0]):
        out[cell] = _log_odds(bins, of_cells, detection, beside, field, strength, state, cell)


@kernel
def gibbs_sweep(
    rows: BeamRows,
    bins: BeamBins,
    of_cells: CellRows,
    detection: FloatArray,
    beside: npt.NDArray[np.int32],
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
        beside: see there.
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
        odds = _log_odds(bins, of_cells, detection, beside, field, strength, state, cell)
        p = 1.0 / (1.0 + math.exp(-odds))
        total[cell] += p
        if (uniform[cell] < p) != (state[cell] == 1):
            _flip(rows, bins, of_cells, detection, state, cell)
            flips += 1
    return flips


@kernel
def climb_sweep(
    rows: BeamRows,
    bins: BeamBins,
    of_cells: CellRows,
    detection: FloatArray,
    beside: npt.NDArray[np.int32],
    field: FloatArray,
    strength: float,
    state: State,
) -> int:
    """Turn over each cell of which the other state is more probable, given all others.

    Arguments as in `gibbs_sweep`. No step lowers the posterior of the map.

    Returns:
        How many cells were turned over; 0: no single one could raise the posterior.
    """
    flips = 0
    for cell in range(state.shape[0]):
        odds = _log_odds(bins, of_cells, detection, beside, field, strength, state, cell)
        if (odds < -_DRAW) if state[cell] == 1 else (odds > _DRAW):
            _flip(rows, bins, of_cells, detection, state, cell)
            flips += 1
    return flips
