# SPDX-License-Identifier: Apache-2.0
"""LZF decompression, for PCD files.

A stream of runs: a control byte below 32 announces one byte more of literals than it says; any
other repeats bytes already written, 3 bits of length (7: one byte more follows) and 13 of distance.
The packages on PyPI are C extensions that would have to be built on some machines; in plain Python
a cloud takes 25 times as long. The readable version is in tests/naive/lzf.py.

Source: liblzf 3.6 (Lehmann), lzf_d.c, for the format.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing

__all__ = ["BEFORE_START", "CUT_OFF", "MORE", "most_bytes", "unpack_runs"]

CUT_OFF, BEFORE_START, MORE = -1, -2, -3
"""It ends within a run; it refers to bytes before its start; it holds more than fits."""

Bytes = npt.NDArray[np.uint8]


def most_bytes(packed: int) -> int:
    """The most that so many bytes can become: a run of 264 bytes takes 3."""
    return 88 * packed + 264


@borrowing
def unpack_runs(data: Bytes, out: Bytes) -> int:
    """Decompress LZF data.

    Args:
        data: the compressed bytes, shape (n,).
        out: takes what comes out, shape (as much as is expected,).

    Returns:
        How many bytes came out, or CUT_OFF, BEFORE_START or MORE.
    """
    at, end, to, room = 0, data.shape[0], 0, out.shape[0]
    while at < end:
        control = np.int64(data[at])
        at += 1
        if control < 32:
            length = control + 1
            if at + length > end:
                return CUT_OFF
            if to + length > room:
                return MORE
            for k in range(length):
                out[to + k] = data[at + k]
            at += length
        else:
            length = control >> 5
            if length == 7:
                if at == end:
                    return CUT_OFF
                length += np.int64(data[at])
                at += 1
            length += 2
            if at == end:
                return CUT_OFF
            start = to - (((control & 31) << 8 | np.int64(data[at])) + 1)
            at += 1
            if start < 0:
                return BEFORE_START
            if to + length > room:
                return MORE
            # Byte by byte: a run may overlap what it writes, a distance of 1 repeats one byte.
            for k in range(length):
                out[to + k] = out[start + k]
        to += length
    return to
