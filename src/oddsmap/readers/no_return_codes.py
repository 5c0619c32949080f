# SPDX-License-Identifier: Apache-2.0
"""The numbers by which a log says "no return", found by how often they occur.

A SICK scanner that sees nothing answers with one fixed number (81.83 m), some drivers with several
(32.767, 32.765, 32.763 and 32.759 m). Real readings that far away are rare and spread over many
values, so that such a number stands out at the top of the range. A few readings may lie above it:
faults, or the number with a little noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["NoReturnCode", "describe_codes", "find_codes", "find_doubtful_code"]

# A code occurs this many times as often as the values below it: at least 5 times, since each of
# those occurs once or more.
_MIN_RATIO = 5
# How many of the next lower distinct values give the median count a value is compared with.
_REFERENCE_VALUES = 50
# Fewer distinct values than this say nothing about what is usual: a toy log with readings of 1 m
# and 2 m only would lose all its 2 m walls. The five logs measured all have the full 50.
_MIN_REFERENCE_VALUES = 10

# Below the very top more is asked of a code, for a robot that stands still before a wall reads one
# value again and again, too. It must be among so many of the largest distinct values, ...
_TOP_VALUES = 20
# ... occur this many times as often as the values below it, and, with the codes right below it, as
# all readings above it together ...
_MIN_RATIO_BELOW_TOP = 20
# ... and make up this share of all readings. In two public logs it was a quarter and more.
_MIN_SHARE = 0.005

# Where a value is so much more frequent than the others and has this share, it is worth a question.
_DOUBTFUL_SHARE = 0.0005
_DOUBTFUL_VALUES = 50


_Values = npt.NDArray[np.float64]
_Counts = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class NoReturnCode:
    """A `value` [m] that means "no return", and its `count` in the log."""

    value: float
    count: int


def find_codes(ranges: npt.NDArray[np.float64]) -> tuple[NoReturnCode, ...]:
    """Find the values that occur abnormally often at the very top of the range.

    Taken from the largest value down, a value is a code while it occurs at least 5 times as often
    as the median of the next 50 lower distinct values; the first that does not ends the search. A
    spike below it, among the 20 largest distinct values, is a code where hardly anything is above
    it: 20 times as frequent as that median and as all readings above it, and half a per cent of
    all.

    Args:
        ranges: all readings of a log [m], shape (n,); NaN and infinities are ignored.

    Returns:
        The codes, largest first. A reading at or above the last one is no return.
    """
    values, counts = _from_the_top(ranges)
    at_top = _run_of_codes(values, counts, 0)
    for i in range(len(at_top), min(_TOP_VALUES, len(values))):
        if _ratio(counts, i) < _MIN_RATIO_BELOW_TOP:
            continue
        codes = _run_of_codes(values, counts, i)
        together = sum(code.count for code in codes)
        above = int(counts[:i].sum())
        if together >= max(_MIN_RATIO_BELOW_TOP * above, _MIN_SHARE * int(counts.sum())):
            return codes
    return at_top


def find_doubtful_code(
    ranges: npt.NDArray[np.float64], codes: tuple[NoReturnCode, ...]
) -> NoReturnCode | None:
    """Find the largest value that is odd enough for a question, and not sure enough for a code.

    Args:
        ranges: all readings of a log [m], shape (n,); NaN and infinities are ignored.
        codes: those found in them.
    """
    values, counts = _from_the_top(ranges)
    sure = codes[-1].value if codes else np.inf
    for i in range(min(_DOUBTFUL_VALUES, len(values))):
        often = counts[i] >= _DOUBTFUL_SHARE * int(counts.sum())
        if values[i] < sure and often and _ratio(counts, i) >= _MIN_RATIO_BELOW_TOP:
            return NoReturnCode(float(values[i]), int(counts[i]))
    return None


def _from_the_top(ranges: npt.NDArray[np.float64]) -> tuple[_Values, _Counts]:
    """The distinct finite readings from the largest down, and how often each occurs."""
    values, counts = np.unique(ranges[np.isfinite(ranges)], return_counts=True)
    return values[::-1], counts[::-1]


def _ratio(counts: _Counts, i: int) -> float:
    """How often a value occurs, in medians of the counts of the next lower ones; 0: too few."""
    reference = counts[i + 1 : i + 1 + _REFERENCE_VALUES]
    if len(reference) < _MIN_REFERENCE_VALUES:
        return 0.0
    return float(counts[i]) / float(np.median(reference))


def _run_of_codes(values: _Values, counts: _Counts, start: int) -> tuple[NoReturnCode, ...]:
    """The values from one down that are frequent without a gap."""
    end = start
    while end < len(values) and _ratio(counts, end) >= _MIN_RATIO:
        end += 1
    return tuple(NoReturnCode(float(values[i]), int(counts[i])) for i in range(start, end))


def describe_codes(codes: tuple[NoReturnCode, ...], larger: int = 0) -> str:
    """Say in one sentence which values are taken as "no return", and why.

    Args:
        codes: what was found.
        larger: how many readings lie above them.
    """
    taken = "taken as 'no return'" + (f", like {larger} larger readings" if larger else "")
    if len(codes) == 1:
        value, count = codes[0].value, codes[0].count
        return f"{value:g} m occurs {count} times at the top of the range: {taken}"
    listed = ", ".join(f"{code.value:g} m ({code.count} times)" for code in codes)
    return f"{listed} stand out at the top of the range: {taken}"
