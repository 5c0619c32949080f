# SPDX-License-Identifier: Apache-2.0
"""Squared distances by looking at every pair of cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray

__all__ = ["cells_of", "nearest_squared"]


def cells_of(lo: npt.ArrayLike, hi: npt.ArrayLike) -> IntArray:
    """The cells of a box, x fastest: shape (n, d), x first."""
    first = np.asarray(lo, np.int64)
    sides = np.asarray(hi, np.int64) - first
    cells = np.array(list(np.ndindex(*sides[::-1])), np.int64).reshape(-1, len(first))
    return cells[:, ::-1] + first


def nearest_squared(
    cells: IntArray, marked: IntArray, reach: int | None = None
) -> list[int | None]:
    """The least squared distance of each cell to a marked one; None where none is within reach."""
    if len(marked) == 0:
        return [None] * len(cells)
    least = [int(((marked - cell) ** 2).sum(axis=1).min()) for cell in cells]
    return [None if reach is not None and squared > reach else squared for squared in least]
