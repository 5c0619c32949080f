# SPDX-License-Identifier: Apache-2.0
"""Stamps as words: `12.5` is a decimal number of seconds, or 12 seconds and 5 nanoseconds.

ROS stamps are two whole numbers, and programs that print them as `%d.%d` lose the zeros between:
1600000000.020000000 becomes 1600000000.20000000, 0.18 s later. Of several such words one can tell:
a decimal fraction may start with 0, which a whole number never does, and is written with as many
digits as the others or without zeros at its end.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Literal

__all__ = ["MAX_STAMP_NS", "kind_of_stamps", "split_stamp_ns"]

MAX_STAMP_NS = 2**63 - 1

_WORD = re.compile(r"(\d+)\.(\d+)")

# With so few digits they would all be in the first hundredth of a second.
_DECIMAL_DIGITS = 7


def kind_of_stamps(words: Sequence[str]) -> Literal["decimal", "split", "unclear"]:
    """What stands behind the point of some stamps.

    Args:
        words: the stamps of one source; one that is not digits, a point and digits makes them all
            decimal.

    Returns:
        "decimal": a fraction of a second, as a number has it; "split": whole nanoseconds, not
        filled with zeros; "unclear": it may be either, and they differ.
    """
    matches = [_WORD.fullmatch(word) for word in words]
    fractions = {found[2] for found in matches if found}
    lengths = {len(fraction) for fraction in fractions}
    if not all(matches) or not lengths or max(lengths) > 9 or max(lengths) <= _DECIMAL_DIGITS:
        return "decimal"
    long = [fraction for fraction in fractions if len(fraction) > 1]
    if lengths == {9} or any(fraction.startswith("0") for fraction in long):
        return "decimal"
    if len(lengths) > 1 and any(fraction.endswith("0") for fraction in long):
        return "split"
    return "unclear"


def split_stamp_ns(word: str) -> int:
    """A word `seconds.nanoseconds` as nanoseconds; it is one by `kind_of_stamps`."""
    seconds, nanoseconds = word.split(".")
    return int(seconds) * 10**9 + int(nanoseconds)
