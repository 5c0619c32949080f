# SPDX-License-Identifier: Apache-2.0
"""How large things may be: memory, coordinates, tiles."""

from __future__ import annotations

import os

__all__ = ["MAX_COORDINATE", "TILE_SIDE", "TOO_LONG", "in_metres", "memory_limit"]

TOO_LONG = "use a coarser resolution, or range_max where a reading is too long"
"""What to do where one scan spans more than can be held."""

# Beyond this many cells from the map's origin no precision is left within a cell.
MAX_COORDINATE = float(1 << 45)


# 32 x 32 cells: measured best of 16, 32 and 64 for 2D scans at 0.05 m. 8^3 in 3D.
TILE_SIDE = {2: 32, 3: 8}


def in_metres(length: float) -> str:
    """A length in four digits, for messages: 14560, not 1.456e+04."""
    return f"{float(f'{length:.4g}'):.7g}"


def memory_limit() -> int:
    """Bytes that one map may use: 80 % of the machine's memory."""
    try:
        return int(0.8 * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):  # not a POSIX system
        return 1 << 62
