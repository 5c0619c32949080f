# SPDX-License-Identifier: Apache-2.0
"""What is kept of a map's beams, so that turning over one cell is quick to judge and to do.

For each range bin of a beam two numbers are kept, from which a cell of that bin has its two
likelihoods in O(1), with the sums of `beam_factor.py` and q_i = m_i:

    base = A_k + T_k L_k,  gain = T_k (B_k - L_k) Q_k,
    f(m_i) = base + gain / u_i * (1 - d_i m_i),  u_i = 1 - d_i m_i of the map as it is.

And the rows are sorted a second time, by cell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.infer.beam_factor import BeamRows
from oddsmap.kernels.infer.first_echo import Noise, echo_likelihood
from oddsmap.kernels.jit import inlined, kernel

__all__ = [
    "BeamBins",
    "CellRows",
    "chance_of",
    "count_bins",
    "list_bins",
    "quiet",
    "renew",
    "renew_all",
    "silence",
    "turn_rows",
]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
State = npt.NDArray[np.uint8]

# A cell that surely returns the beam and is occupied would leave nothing to divide by.
_LEAST_SILENT = 1e-12


class BeamBins(NamedTuple):
    """The range bins that have cells, beam after beam, and what is kept of each."""

    offsets: IntArray
    """First bin of each beam and the end, shape (beams + 1,)."""
    rows: IntArray
    """First row of each bin and the end, shape (bins + 1,)."""
    beams: npt.NDArray[np.int32]
    """Beam of each bin, shape (bins,)."""
    from_bin: FloatArray
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
        bins.none[beam] = echo_likelihood(-1, reading, noise)
        for i in range(begin, end):
            if i == begin or rows.bins[i] != rows.bins[i - 1]:
                bins.rows[count] = i
                bins.beams[count] = beam
                bins.from_bin[count] = echo_likelihood(np.int64(rows.bins[i]), reading, noise)
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
def quiet(chance: float, occupied: int) -> float:
    """u_i of a cell that is occupied (1) or free (0)."""
    return max(1.0 - chance * occupied, _LEAST_SILENT)


@inlined
def chance_of(detection: FloatArray, cell: int) -> float:
    """Chance of detection of a cell, from one for each or one for all."""
    return detection[cell if detection.shape[0] > 1 else 0]


@inlined
def silence(rows: BeamRows, bins: BeamBins, detection: FloatArray, state: State, k: int) -> float:
    """Q_k of bin number k in a map."""
    silent = 1.0
    for i in range(bins.rows[k], bins.rows[k + 1]):
        cell = rows.cells[i]
        silent *= quiet(chance_of(detection, cell) * rows.fractions[i], state[cell])
    return silent


@inlined
def renew(bins: BeamBins, beam: int) -> None:
    """Fill in `base`, `gain` and `likelihood` of one beam, given Q_k."""
    first, last = bins.offsets[beam], bins.offsets[beam + 1]
    through, before = 1.0, 0.0
    for k in range(first, last):
        bins.base[k] = before + through * bins.from_bin[k]
        bins.gain[k] = through
        before += through * (1.0 - bins.silent[k]) * bins.from_bin[k]
        through *= bins.silent[k]
    behind = bins.none[beam]
    bins.likelihood[beam] = before + through * behind
    for k in range(last - 1, first - 1, -1):
        bins.gain[k] *= (behind - bins.from_bin[k]) * bins.silent[k]
        behind = (1.0 - bins.silent[k]) * bins.from_bin[k] + bins.silent[k] * behind


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
        bins.silent[k] = silence(rows, bins, detection, state, k)
    for beam in range(rows.readings.shape[0]):
        renew(bins, beam)
