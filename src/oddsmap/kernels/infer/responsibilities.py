# SPDX-License-Identifier: Apache-2.0
"""What caused each reading: an echo, a random reading or a dropout, and how likely it was at all.

All under the cavity beliefs of the beam's cells (what the map believes without this beam), as in
`beam_factor.py`; with T_k the chance that nothing before bin k echoes and Q_k that bin k does not,

    p(z) = sum_k T_k (1 - Q_k) L_k + T_K L_inf,

whose terms are split by cause: L_k = p(z | echo of k, true reading) + p_random / span for a finite
reading; for a no-return the shares of p_dropout and of true readings.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.infer.beam_factor import NAT, BeamRows, beam_room, chances
from oddsmap.kernels.infer.first_echo import Noise, echo_likelihood
from oddsmap.kernels.jit import kernel

__all__ = ["DROPOUT", "LIKELIHOOD", "RANDOM", "SQUARES", "causes"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# What a reading that no map explains is taken to be likely by, so that its shares are numbers.
_NOTHING = 1e-300

LIKELIHOOD, RANDOM, DROPOUT, SQUARES = range(4)
"""Columns of the result of `causes`."""


@kernel
def causes(
    rows: BeamRows,
    noise: Noise,
    detection: FloatArray,
    belief: IntArray,
    messages: npt.NDArray[np.int32],
    out: FloatArray,
) -> None:
    """Likelihood and causes of each beam's reading.

    Args:
        rows: the beams; their readings are finite or at least range_max.
        noise: what the sensor adds.
        detection: chance that an occupied cell wholly in the cone returns the beam, for each cell
            or one for all, shape (1,).
        belief: log odds of each cell [1 / NAT].
        messages: of each row [1 / NAT]; taken out of the belief.
        out: takes p(z) as in `first_echo.echo_likelihood`, P(random reading | z), P(dropout | z)
            and the sum over bins of P(true echo of k | z) (z - r_k)^2 [m^2], shape (beams, 4).
    """
    u, d, _, _ = beam_room(rows)
    true = 1.0 - noise.p_random - noise.p_dropout
    for beam in range(rows.readings.shape[0]):
        begin, end = rows.offsets[beam], rows.offsets[beam + 1]
        reading = rows.readings[beam]
        for i in range(begin, end):
            u[i - begin] = 1.0 / (1.0 + math.exp(-(belief[rows.cells[i]] - messages[i]) / NAT))
        chances(rows, begin, end, detection, u, d)
        lost = reading >= noise.range_max
        # What the reading is likely by without a true echo, whatever stands there.
        other = noise.p_dropout if lost else echo_likelihood(-1, reading, noise)
        through, heard, squares = 1.0, 0.0, 0.0
        i = begin
        while i < end:
            k = np.int64(rows.bins[i])
            silent = 1.0
            while i < end and rows.bins[i] == k:
                silent *= u[i - begin]
                i += 1
            echo = through * (1.0 - silent) * (echo_likelihood(k, reading, noise) - other)
            through *= silent
            heard += echo
            if not lost:
                off = reading - (k + 0.5) * noise.bin_width
                squares += echo * off * off
        if lost:
            heard += through * true
        total = max(heard + other, _NOTHING)
        out[beam, LIKELIHOOD] = total
        out[beam, RANDOM] = 0.0 if lost else other / total
        out[beam, DROPOUT] = other / total if lost else 0.0
        out[beam, SQUARES] = squares / total
