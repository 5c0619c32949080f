# SPDX-License-Identifier: Apache-2.0
"""The window prior of whole maps, window by window."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def log_prior(
    occupied: npt.NDArray[np.integer], potentials: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Log p(m) of maps, shape (..., ny, nx), up to a constant; what lies beyond is free.

    Every 3 x 3 window counts that has a cell of the map, less what it would be without anything.
    """
    *_, ny, nx = occupied.shape
    wide = np.pad(occupied.astype(np.int64), [(0, 0)] * (occupied.ndim - 2) + [(2, 2), (2, 2)])
    total = np.zeros(occupied.shape[:-2])
    for y in range(ny + 2):
        for x in range(nx + 2):
            number = np.zeros(occupied.shape[:-2], np.int64)
            for row in range(3):
                for column in range(3):
                    number += wide[..., y + row, x + column] * 2 ** (3 * row + column)
            total += potentials[number] - potentials[0]
    return total
