# SPDX-License-Identifier: Apache-2.0
"""Many poses in batches, side by side in threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.query.given_numbers import check_threads

__all__ = ["over_poses"]

# Beams of all poses of a batch: some 3 MB of rays.
_BATCH = 1 << 16


def over_poses(
    count: int, beams: int, add_up: Callable[[slice, FloatArray], None], threads: int
) -> FloatArray:
    """One number for each pose.

    Args:
        count: of poses.
        beams: of each pose.
        add_up: fills the numbers of a slice of poses.
        threads: how many; no number depends on it.

    Raises:
        ConfigError: less than one thread.
    """
    check_threads(threads)
    out = np.zeros(count)
    if beams == 0:
        return out
    size = max(1, _BATCH // beams)
    parts = [slice(first, min(first + size, count)) for first in range(0, count, size)]
    if threads == 1 or len(parts) < 2:
        for part in parts:
            add_up(part, out[part])
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda part: add_up(part, out[part]), parts))
    return out
