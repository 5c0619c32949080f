# SPDX-License-Identifier: Apache-2.0
"""Numbers in a text, to the nearest double: those that need no more than one rounding.

A whole number below 2^53 and a power of ten up to 10^22 are doubles, so that their product or
quotient is rounded once, to the nearest. Logs hold such numbers; whatever else stands there is left
to slower and more general code.

Source: W. Clinger: How to read floating point numbers accurately. PLDI 1990, section 4.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined

__all__ = ["parse_decimals"]

TENS = np.array([float(10**power) for power in range(23)])
_MOST = (1 << 53) // 10 - 1
"""A whole number up to here takes one more digit and is a double."""

SPACE, PLUS, MINUS, POINT, ZERO, SMALL_E = 32, 43, 45, 46, 48, 101


@inlined
def _is_space(byte: np.uint8) -> bool:
    return byte == SPACE or (9 <= byte <= 13)


@borrowing
def parse_decimals(text: npt.NDArray[np.uint8], numbers: npt.NDArray[np.float64]) -> int:
    """Read the numbers of a text that white space separates.

    A number has an optional sign, digits with at most one point among or beside them, and
    optionally e or E with a whole number.

    Args:
        text: its bytes, shape (n,).
        numbers: takes the numbers, shape (as many as are expected,).

    Returns:
        How many numbers there are; -1 where a word is no such number, is one that takes more than
        one rounding, or where there are more numbers than expected.
    """
    at, end, count = 0, text.shape[0], 0
    while True:
        while at < end and _is_space(text[np.uint64(at)]):
            at += 1
        if at == end:
            return count
        if count == numbers.shape[0]:
            return -1
        falls = text[np.uint64(at)] == MINUS
        if falls or text[np.uint64(at)] == PLUS:
            at += 1
        whole, digits, decimals, past_point = np.int64(0), 0, 0, 0
        while at < end:
            byte = text[np.uint64(at)]
            if byte == POINT:
                if past_point:
                    return -1
                past_point = 1
            elif ZERO <= byte <= ZERO + 9:
                if whole > _MOST:
                    return -1
                whole = 10 * whole + np.int64(byte) - ZERO
                digits += 1
                decimals += past_point
            else:
                break
            at += 1
        if digits == 0:
            return -1
        power = 0
        if at < end and (text[np.uint64(at)] | 32) == SMALL_E:
            at += 1
            small = at < end and text[np.uint64(at)] == MINUS
            if at < end and (small or text[np.uint64(at)] == PLUS):
                at += 1
            places = 0
            while at < end and ZERO <= text[np.uint64(at)] <= ZERO + 9 and places < 4:
                power = 10 * power + np.int64(text[np.uint64(at)]) - ZERO
                places += 1
                at += 1
            if places == 0:
                return -1
            power = -power if small else power
        if at < end and not _is_space(text[np.uint64(at)]):
            return -1
        power -= decimals
        if power < -22 or power > 22:
            return -1
        value = float(whole)
        value = value * TENS[power] if power >= 0 else value / TENS[-power]
        numbers[np.uint64(count)] = -value if falls else value
        count += 1
