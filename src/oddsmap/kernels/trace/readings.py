# SPDX-License-Identifier: Apache-2.0
"""The one rule for readings: which of them say something, and how far.

Everything that takes ranges asks it: rays and cones of the filter, depth images, full maps.
docs/conventions.md has it in words.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import inlined, kernel

__all__ = ["BELOW", "CLEARS", "NAN", "NO_RETURN", "SEEN", "ZERO", "Limits", "judge", "judge_all"]

FloatArray = npt.NDArray[np.float64]

NAN, BELOW, NO_RETURN, ZERO, CLEARS, SEEN = 0, 1, 2, 3, 4, 5
"""No number; below range_min; a no-return that clears nothing; exactly 0; a no-return that clears;
a return."""

Limits: TypeAlias = tuple[float, float, float, float]
"""range_min, range_max (inf where unknown), how far +Inf clears, how far a finite no-return clears
(NaN: not at all), all in metres."""


@inlined
def judge(reading: float, limits: Limits) -> tuple[int, float]:
    """What a reading [m] is, and how far it says something [m]; -Inf is below any range_min.

    Exactly 0 is what drivers write where there was no return, whatever the reason: as a hit it
    would mark the sensor's own cell, as a no-return it would clear what nobody looked through.
    """
    if math.isnan(reading):
        return NAN, math.nan
    if reading < limits[0]:
        return BELOW, math.nan
    if reading == 0.0:
        return ZERO, math.nan
    if reading < limits[1]:
        return SEEN, reading
    reach = limits[2] if reading == np.inf else limits[3]
    if math.isnan(reach):
        return NO_RETURN, math.nan
    return CLEARS, reach


@kernel
def judge_all(
    ranges: FloatArray, limits: Limits, verdict: npt.NDArray[np.uint8], reach: FloatArray
) -> None:
    """`judge` for each of some readings; all arrays have shape (n,)."""
    for i in range(ranges.shape[0]):
        verdict[i], reach[i] = judge(ranges[i], limits)
