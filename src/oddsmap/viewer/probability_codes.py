# SPDX-License-Identifier: Apache-2.0
"""Probabilities as whole numbers, which pack well and which a graphics card looks up.

0 is a cell of which nothing is known; from 1 on numbers rise with the probability. Where values
repeat, as in ROS maps and OctoMaps, they are listed, and nothing is rounded. Else they go to the
nearest of 65535 places, evenly spaced along p + 0.001 l, l being the log odds: so a probability is
kept within 1e-5, and log odds far from 0, where p itself hardly moves, within .01.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.odds import logit

__all__ = ["ProbabilityCodes", "codes_of"]

_PLACES = (1 << 16) - 1
_SLOPE = 1e-3
# sigmoid(40) is 1 to the last digit of a double.
_LARGEST = 40.0
_FIRST, _LAST = -_SLOPE * _LARGEST, 1.0 + _SLOPE * _LARGEST
# A listed value takes 8 bytes: no more than half a byte for each cell.
_CELLS_A_VALUE = 16
_FEW_VALUES = 255
_GLANCE = 1 << 18


class ProbabilityCodes(NamedTuple):
    """The numbers of some probabilities, and what they stand for."""

    codes: npt.NDArray[Any]
    """From 1 on, shape (n,), uint8 or uint16."""
    values: FloatArray | None
    """The probabilities that 1, 2, ... stand for; None: the evenly spaced ones."""


def codes_of(probability: FloatArray) -> ProbabilityCodes:
    """Numbers of probabilities.

    Args:
        probability: from 0 to 1, shape (n,).
    """
    values = _repeated(probability)
    if values is not None:
        codes = np.searchsorted(values, probability) + 1
        return ProbabilityCodes(codes.astype(np.min_scalar_type(len(values))), values)
    with np.errstate(divide="ignore"):
        log_odds = np.clip(logit(probability), -_LARGEST, _LARGEST)
    place = (probability + _SLOPE * log_odds - _FIRST) * ((_PLACES - 1) / (_LAST - _FIRST))
    nearest = np.clip(np.rint(place), 0, _PLACES - 1) + 1
    return ProbabilityCodes(nearest.astype(np.uint16), None)


def _repeated(probability: FloatArray) -> FloatArray | None:
    """The different values, in order, if they are few enough to be listed."""
    most = max(_FEW_VALUES, min(_PLACES, len(probability) // _CELLS_A_VALUE))
    if len(np.unique(probability[:_GLANCE])) > most:
        return None
    values = np.unique(probability)
    return values if len(values) <= most else None
