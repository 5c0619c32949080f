# SPDX-License-Identifier: Apache-2.0
"""Bytes as text that may stand in a page: 13 bits are two of 91 characters.

That takes 16/13 of the bytes, Base64 4/3: of a map that hardly compresses the difference decides
whether the page is within 1.3 of the saved map.
"""

from __future__ import annotations

import numpy as np

__all__ = ["text_of"]

# All that ASCII shows, but what begins an element or a reference, or ends an attribute.
_DIGITS = np.array([code for code in range(33, 127) if chr(code) not in '"&<'], np.uint8)
_BITS = 13
# Bytes handled at a time, a multiple of 13: each bit of them is a byte meanwhile.
_PART = _BITS << 16


def text_of(data: bytes) -> str:
    """The bytes as text; who reads it has to know their number."""
    padded = data + bytes(-len(data) % _BITS)
    weights = 1 << np.arange(_BITS)[::-1]
    parts = []
    for start in range(0, len(padded), _PART):
        part = np.frombuffer(padded[start : start + _PART], np.uint8)
        numbers = np.unpackbits(part).reshape(-1, _BITS) @ weights
        parts.append(_DIGITS[np.stack(np.divmod(numbers, len(_DIGITS)), axis=1)].tobytes())
    return b"".join(parts).decode("ascii")
