# SPDX-License-Identifier: Apache-2.0
"""LZF decompression, for PCD files: what the kernel says, in words."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["decompress"]


def decompress(data: bytes, size: int) -> npt.NDArray[np.uint8]:
    """Decompress LZF data.

    Args:
        data: the compressed bytes.
        size: how many bytes must come out.

    Raises:
        ValueError: the data are corrupt, or of another size.
    """
    from oddsmap.kernels.lzf import BEFORE_START, CUT_OFF, MORE, most_bytes, unpack_runs

    # Whatever a damaged header announces, no more memory is taken than can be needed.
    out = np.empty(min(size, most_bytes(len(data))), np.uint8)
    held = unpack_runs(np.frombuffer(data, np.uint8), out)
    if held == CUT_OFF:
        raise ValueError("it ends within a run")
    if held == BEFORE_START:
        raise ValueError("it refers to bytes before its start")
    if held != size:
        text = f"more than {size}" if held == MORE else str(held)
        raise ValueError(f"it holds {text} bytes, {size} are announced")
    return out
