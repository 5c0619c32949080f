# SPDX-License-Identifier: Apache-2.0
"""How likely a reading was to end where it did, step by step along the beam.

The range is cut into steps. With F the predictive distribution of the reading,

    h_j = (F(r_{j+1}) - F(r_j)) / (1 - F(r_j))

is the chance that it ends in step j, having come that far. Whether it does is an event whose
chance, given all earlier ones, is h_j: of well predicted readings the events with h near 0.7
happen in 70 % of cases, however the steps of a beam depend on each other.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.infer.first_echo import Noise
from oddsmap.kernels.jit import inlined, kernel

__all__ = ["tally_hazards"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# Beyond so many sigma nothing is left of the noise: 1e-9.
_FAR = 6.0
_NOTHING_LEFT = 1e-12


@inlined
def _below(x: float) -> float:
    # The standard normal distribution.
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


@kernel
def tally_hazards(
    readings: FloatArray,
    noise: Noise,
    echo: FloatArray,
    step: float,
    count: IntArray,
    predicted: FloatArray,
    happened: IntArray,
) -> None:
    """Predict the steps of each beam up to its reading, and note which of them it ended in.

    Args:
        readings: ranges [m], shape (beams,), none below range_min; at or above range_max: no
            return, which ends in no step.
        noise: what the sensor adds.
        echo: P(first echo from bin k), shape (beams, bins), right for echoes up to one step and
            six sigma behind the reading.
        step: length of a step [m]; the last one ends at range_max.
        count: of predictions in bins of equal width between 0 and 1, added to, shape (n,).
        predicted: the sum of their probabilities, likewise.
        happened: how many came true, likewise.
    """
    span = noise.range_max - noise.range_min
    steps = math.ceil(span / step - 1e-9)
    true = 1.0 - noise.p_random - noise.p_dropout
    mass = np.empty(steps)
    bins = count.shape[0]
    for beam in range(readings.shape[0]):
        mass[:] = noise.p_random * step / span
        mass[steps - 1] = noise.p_random * (span - (steps - 1) * step) / span
        left = 1.0
        for k in range(echo.shape[1]):
            chance = true * echo[beam, k]
            if chance <= 0.0:
                continue
            r = (k + 0.5) * noise.bin_width - noise.range_min
            first = int(max((r - _FAR * noise.sigma) / step, 0.0))
            last = min(int(max((r + _FAR * noise.sigma) / step, 0.0)) + 1, steps)
            before = _below((first * step - r) / noise.sigma)
            if first == 0:
                left -= chance * before  # what noise takes below range_min is no reading
            for j in range(first, last):
                after = _below((min((j + 1) * step, span) - r) / noise.sigma)
                mass[j] += chance * (after - before)
                before = after
        reading = readings[beam]
        end = steps
        if reading < noise.range_max:
            # A reading on a border belongs to the step that begins there; the quotient can be
            # rounded to the other side of it.
            end = int((reading - noise.range_min) / step)
            if noise.range_min + (end + 1) * step <= reading:
                end += 1
            elif noise.range_min + end * step > reading:
                end -= 1
            end = min(end, steps - 1)
        for j in range(min(end + 1, steps)):
            hazard = min(mass[j] / max(left, _NOTHING_LEFT), 1.0)
            place = min(int(hazard * bins), bins - 1)
            count[place] += 1
            predicted[place] += hazard
            if j == end:
                happened[place] += 1
            left -= mass[j]
