# SPDX-License-Identifier: Apache-2.0
"""The numbers by which a log says "no return", found by how often they occur.

A SICK scanner that sees nothing answers with one fixed number (81.83 m), some drivers with several
(32.767, 32.765, 32.763 and 32.759 m). Real readings that far away are rare and spread over many
values, so that such a number stands out at the top of the range.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["NoReturnCode", "describe_codes", "find_codes"]

# A code occurs this many times as often as the values below it: at least 5 times, since each of
# those occurs once or more.
_MIN_RATIO = 5
# How many of the next lower distinct values give the median count a value is compared with.
_REFERENCE_VALUES = 50
# Fewer distinct values than this say nothing about what is usual: a toy log with readings of 1 m
# and 2 m only would lose all its 2 m walls. The five logs measured all have the full 50.
_MIN_REFERENCE_VALUES = 10


@dataclass(frozen=True, slots=True)
class NoReturnCode:
    """A `value` [m] that means "no return", and its `count` in the log."""

    value: float
    count: int


def find_codes(ranges: npt.NDArray[np.float64]) -> tuple[NoReturnCode, ...]:
    """Find the values that occur abnormally often at the very top of the range.

    Taken from the largest value down, a value is a code while it occurs at least 5 times as often
    as the median of the next 50 lower distinct values; the first that does not ends the search.

    Args:
        ranges: all readings of a log [m], shape (n,); NaN and infinities are ignored.

    Returns:
        The codes, largest first. A reading at or above the last one is no return.
    """
    ascending, ascending_counts = np.unique(ranges[np.isfinite(ranges)], return_counts=True)
    values, counts = ascending[::-1], ascending_counts[::-1]
    codes: list[NoReturnCode] = []
    for i, (value, count) in enumerate(zip(values, counts, strict=True)):
        reference = counts[i + 1 : i + 1 + _REFERENCE_VALUES]
        if len(reference) < _MIN_REFERENCE_VALUES:
            break
        if count < _MIN_RATIO * float(np.median(reference)):
            break
        codes.append(NoReturnCode(float(value), int(count)))
    return tuple(codes)


def describe_codes(codes: tuple[NoReturnCode, ...]) -> str:
    """Say in one sentence which values are taken as "no return", and why."""
    if len(codes) == 1:
        value, count = codes[0].value, codes[0].count
        return f"{value:g} m occurs {count} times at the top of the range: taken as 'no return'"
    listed = ", ".join(f"{code.value:g} m ({code.count} times)" for code in codes)
    return f"{listed} stand out at the top of the range: taken as 'no return'"
