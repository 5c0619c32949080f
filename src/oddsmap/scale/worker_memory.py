# SPDX-License-Identifier: Apache-2.0
"""Memory that a worker keeps at hand between one use and the next.

Dask starts workers with MALLOC_TRIM_THRESHOLD_ (docs.dask.org, "Automatically trim memory"), so
that the C library gives freed memory back to the system at once. zstd takes and frees a megabyte or
so for each chunk of cells: with its pages taken anew each time, packing the map of 400 scans took
5.0 s of CPU (1.8 million page faults) where it takes 1.6 s without that setting, and as set here.
"""

from __future__ import annotations

import os
from contextlib import suppress
from functools import cache

__all__ = ["keep_some_memory"]

_M_TOP_PAD, _M_MMAP_THRESHOLD = -2, -3  # malloc.h of the GNU C library
_KEPT = 16 << 20
_FROM_THE_SYSTEM = 4 << 20  # a piece of this size is asked for, and given back, on its own


@cache
def keep_some_memory() -> None:
    """Let the C library keep 16 MB of what is freed, where it was told to keep next to nothing."""
    if "MALLOC_TRIM_THRESHOLD_" not in os.environ:
        return
    import ctypes

    # Other libraries have no such call, and do not read that variable either.
    with suppress(OSError, AttributeError, TypeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_M_TOP_PAD, _KEPT)
        mallopt(_M_MMAP_THRESHOLD, _FROM_THE_SYSTEM)
