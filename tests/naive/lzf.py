# SPDX-License-Identifier: Apache-2.0
"""LZF decompression, byte by byte.

A stream of runs: a control byte below 32 announces one byte more of literals than it says; any
other repeats bytes already written, 3 bits of length (7: one byte more follows) and 13 of distance.
The oracle of `oddsmap.kernels.lzf`.

Source: liblzf 3.6 (Lehmann), lzf_d.c, for the format.
"""

from __future__ import annotations

__all__ = ["decompress"]


def decompress(data: bytes, size: int) -> bytes:
    """Decompress LZF data.

    Args:
        data: the compressed bytes.
        size: how many bytes must come out.

    Raises:
        ValueError: the data are corrupt, or of another size.
    """
    out = bytearray()
    position, end = 0, len(data)
    try:
        while position < end:
            control = data[position]
            position += 1
            if control < 32:
                literals = data[position : position + control + 1]
                if len(literals) != control + 1:
                    raise ValueError("it ends within a run of literals")
                out += literals
                position += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[position]
                position += 1
            length += 2
            distance = ((control & 31) << 8 | data[position]) + 1
            position += 1
            start = len(out) - distance
            if start < 0:
                raise ValueError("it refers to bytes before its start")
            run = out[start : start + length]
            # A run may overlap what it writes: a distance of 1 repeats one byte.
            out += run if distance >= length else (run * (length // distance + 1))[:length]
            if len(out) > size:
                break
    except IndexError:
        raise ValueError("it ends within a run") from None
    if len(out) != size:
        raise ValueError(
            f"it holds {'more than ' if len(out) > size else ''}"
            f"{min(len(out), size)} bytes, {size} are announced"
        )
    return bytes(out)
