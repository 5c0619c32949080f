# SPDX-License-Identifier: Apache-2.0
"""The forward sensor model of beams: which bin the first echo comes from, and p(z | map, pose).

For a beam whose cells are sorted into bins k = 0, 1, ... (`trace/cone_cells.py`), with d the
chance that an occupied cell returns the beam and m whether it is occupied (or how probably):

    T_0 = 1,  Q_k = prod over bin k of (1 - d m),
    P(first echo from k) = T_k (1 - Q_k),  T_{k+1} = T_k Q_k,  P(no echo) = T_K,
    p(z) = sum_k P(first echo from k) L_k + P(no echo) L_inf.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import inlined, kernel

__all__ = ["Noise", "bin_likelihoods", "echo_likelihood", "first_echoes", "likelihoods"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class Noise(NamedTuple):
    """What the sensor adds to the first echo; lengths in metres."""

    range_min: float
    range_max: float
    p_random: float
    p_dropout: float
    sigma: float
    bin_width: float


@inlined
def echo_likelihood(k: int, reading: float, noise: Noise) -> float:
    """L_k = p(z | first echo from bin k), or L_inf = p(z | no echo) for k = -1.

    Args:
        k: the bin; its echo is from its middle.
        reading: the range z [m]; at or above range_max: no return.
        noise: what the sensor adds.

    Returns:
        The probability of a reading within a bin's width of z, or of no return.
    """
    echo = 1.0 - noise.p_random - noise.p_dropout
    if reading >= noise.range_max:
        if k < 0:
            return 1.0 - noise.p_random
        off = (noise.range_max - (k + 0.5) * noise.bin_width) / noise.sigma
        # Ten sigma away nothing is left of the noise: 1e-23, against 1.
        if off > 10.0:
            return noise.p_dropout
        return noise.p_dropout + echo * 0.5 * math.erfc(off / math.sqrt(2.0))
    anywhere = noise.p_random * noise.bin_width / (noise.range_max - noise.range_min)
    off = (reading - (k + 0.5) * noise.bin_width) / noise.sigma
    if k < 0 or abs(off) > 12.0:
        return anywhere
    peak = echo * noise.bin_width / (noise.sigma * math.sqrt(2.0 * math.pi))
    return peak * math.exp(-0.5 * off * off) + anywhere


@kernel
def bin_likelihoods(reading: float, noise: Noise, out: FloatArray) -> float:
    """L_k for k = 0, 1, ..., see `echo_likelihood`.

    Args:
        reading: the range z [m]; at or above range_max: no return.
        noise: what the sensor adds.
        out: filled with L_k, shape (bins,).

    Returns:
        L_inf.
    """
    for k in range(out.shape[0]):
        out[k] = echo_likelihood(k, reading, noise)
    return echo_likelihood(-1, reading, noise)


@kernel
def _first_echo(
    begin: int,
    end: int,
    cells: npt.NDArray[np.signedinteger],
    bins: npt.NDArray[np.int32],
    fractions: npt.NDArray[np.floating],
    occupancy: FloatArray,
    detection: FloatArray,
    out: FloatArray,
) -> float:
    # P(first echo from k) of one beam, out zero before; returns P(no echo).
    step = 0 if detection.shape[0] == 1 else 1
    through = 1.0
    i = begin
    while i < end:
        k = bins[i]
        silent = 1.0
        while i < end and bins[i] == k:
            cell = cells[i]
            silent *= 1.0 - detection[cell * step] * fractions[i] * occupancy[cell]
            i += 1
        out[k] = through * (1.0 - silent)
        through *= silent
    return through


@kernel
def first_echoes(
    offsets: IntArray,
    cells: npt.NDArray[np.signedinteger],
    bins: npt.NDArray[np.int32],
    fractions: npt.NDArray[np.floating],
    occupancy: FloatArray,
    detection: FloatArray,
    out: FloatArray,
    none: FloatArray,
) -> None:
    """Where the first echo of each beam comes from.

    Args:
        offsets: first cell of each beam and the end, shape (beams + 1,).
        cells: places in the window, shape (m,).
        bins: range bin of each cell, never falling along a beam.
        fractions: share of each cell in the cone.
        occupancy: of the window's cells, in [0, 1], flat.
        detection: chance that an occupied cell wholly in the cone returns the beam, for each cell
            of the window or one for all, shape (1,).
        out: zeros, becomes P(first echo from k), shape (beams, bins).
        none: becomes P(no echo), shape (beams,).
    """
    for beam in range(none.shape[0]):
        none[beam] = _first_echo(
            offsets[beam], offsets[beam + 1], cells, bins, fractions, occupancy, detection,
            out[beam],
        )  # fmt: skip


@kernel
def likelihoods(
    readings: FloatArray,
    noise: Noise,
    offsets: IntArray,
    cells: npt.NDArray[np.signedinteger],
    bins: npt.NDArray[np.int32],
    fractions: npt.NDArray[np.floating],
    occupancy: FloatArray,
    detection: FloatArray,
    out: FloatArray,
) -> None:
    """p(z | map, pose) of each beam.

    Args:
        readings: ranges [m], shape (beams,); NaN or below range_min: no information, likelihood 1.
        noise: what the sensor adds.
        offsets: and the next five as in `first_echoes`.
        cells: see there.
        bins: see there.
        fractions: see there.
        occupancy: see there.
        detection: see there.
        out: the likelihoods, as in `bin_likelihoods`, shape (beams,).
    """
    max_bins = 0
    for i in range(bins.shape[0]):
        max_bins = max(max_bins, bins[i] + 1)
    echo, by_bin = np.zeros(max_bins), np.empty(max_bins)
    for beam in range(readings.shape[0]):
        reading = readings[beam]
        if not reading >= noise.range_min:
            out[beam] = 1.0
            continue
        begin, end = offsets[beam], offsets[beam + 1]
        count = bins[end - 1] + 1 if end > begin else 0
        none = _first_echo(begin, end, cells, bins, fractions, occupancy, detection, echo[:count])
        total = none * bin_likelihoods(reading, noise, by_bin[:count])
        for k in range(count):
            total += echo[k] * by_bin[k]
            echo[k] = 0.0
        out[beam] = total
