# SPDX-License-Identifier: Apache-2.0
"""Functions of a cell's votes, worked out once for each pair of counts that occurs.

Millions of cells have few pairs of hits and passes, mostly whole and below 256: 65,536 of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.kernels.units import FRACTION_BITS, ONE

__all__ = ["OfVotes", "VoteTable"]

OfVotes = Callable[[FloatArray, FloatArray], npt.NDArray[Any]]
"""A function of hits and passes [votes], element by element."""

_BITS = 8
_SMALL = ((1 << _BITS) - 1) << FRACTION_BITS


class VoteTable:
    """A function of votes, with the same results to the bit.

    Args:
        function: of hits and passes [votes], shape (n,) each, element by element.
    """

    def __init__(self, function: OfVotes) -> None:
        self._function = function
        kind = function(np.zeros(1), np.zeros(1)).dtype
        self._values = np.empty(1 << 2 * _BITS, kind)
        self._known = np.zeros(1 << 2 * _BITS, np.bool_)

    def __call__(self, hits: IntArray, passes: IntArray) -> npt.NDArray[Any]:
        """The function's values for weights in units of 1/65536 vote, shape (n,) each."""
        small = (hits | passes) & ~_SMALL == 0
        if small.all():
            return self._look_up(hits, passes)
        values = np.empty(len(hits), self._values.dtype)
        values[small] = self._look_up(hits[small], passes[small])
        values[~small] = self._function(hits[~small] / ONE, passes[~small] / ONE)
        return values

    def _look_up(self, hits: IntArray, passes: IntArray) -> npt.NDArray[Any]:
        pair = (hits >> (FRACTION_BITS - _BITS)) | (passes >> FRACTION_BITS)
        if not self._known[pair].all():
            new = np.unique(pair[~self._known[pair]])
            self._values[new] = self._function(
                (new >> _BITS).astype(np.float64), (new & ((1 << _BITS) - 1)).astype(np.float64)
            )
            self._known[new] = True
        values: npt.NDArray[Any] = self._values[pair]
        return values
