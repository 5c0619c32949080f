# SPDX-License-Identifier: Apache-2.0
"""The weight of a scan that has been half forgotten."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.units import FRACTION_BITS, ONE

__all__ = ["scale_units"]


@borrowing
def scale_units(units: npt.NDArray[np.int64], scale: int) -> int:
    """Multiply weights by scale / 65536 in place, each rounded to the nearest unit.

    Args:
        units: weights [1/65536 vote], shape (n,).
        scale: the factor in units of 1/65536, at most 65536, which changes nothing.

    Returns:
        How many weights above 0 have become 0.
    """
    lost = 0
    if scale == ONE:
        return lost
    for k in range(units.shape[0]):
        if units[k] > 0:
            units[k] = (units[k] * scale + ONE // 2) >> FRACTION_BITS
            lost += 1 if units[k] == 0 else 0
    return lost
