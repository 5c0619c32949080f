# SPDX-License-Identifier: Apache-2.0
"""Squared distances from the cells of one box to the marked cells of another, in threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.query.distances import STRIP, count_cells, squared_distances
from oddsmap.query.boxes import Box

__all__ = ["Mask", "Squared", "none_of", "squared_to"]

Mask = npt.NDArray[np.uint8]
Squared = npt.NDArray[Any]
"""int32 or int64, as large as the distances may be."""


def none_of(dtype: npt.DTypeLike) -> int:
    """What stands for no distance: the largest number."""
    return int(np.iinfo(dtype).max)


def squared_to(
    mask: Mask, read: Box, box: Box, reach: int | None, dtype: npt.DTypeLike, threads: int
) -> Squared:
    """Squared distance of each cell of a box to the nearest marked one [cells^2].

    Args:
        mask: not 0 where marked, in the shape of `read`.
        read: the cells of the mask, at least one.
        box: the cells that are asked for.
        reach: the largest squared distance asked for; None: any.
        dtype: of the answer, which must hold all distances between the boxes.
        threads: how many; the result is the same.

    Returns:
        In the shape of `box`; `none_of(dtype)` where no marked cell is within reach.
    """
    none = none_of(dtype)
    limit = none - 1 if reach is None else min(reach, none - 1)
    first = [int(n) for n in (box.lo - read.lo)[::-1]]
    out = np.empty(box.shape, dtype)
    if out.size == 0:
        return out
    layers = np.ascontiguousarray(mask)
    answer = out
    if mask.ndim == 2:  # layers of one row each
        layers, answer, first = layers[:, None], out[:, None], [first[0], 0, first[1]]
    n, (ny, nx) = len(answer), layers.shape[1:]
    # In place where the lines that are read are those that are answered.
    same = answer.shape[1:] == (ny, nx) and first[1:] == [0, 0]
    counts = answer if same else np.empty((n, ny, nx), dtype)
    count_cells(layers, first[0], np.empty(nx, dtype), counts)

    def spread(part: slice) -> None:
        longest, my = max(ny, nx), answer.shape[1]
        squared_distances(
            counts[part], first[1], first[2], limit, none,
            np.empty(longest, dtype), np.empty(longest + 1, dtype), np.empty((STRIP, ny), dtype),
            np.empty((STRIP, my), dtype), np.empty((my, nx), dtype), answer[part],
        )  # fmt: skip

    if threads == 1:
        spread(slice(0, n))
        return out
    step = -(-n // (4 * threads))
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(spread, [slice(at, at + step) for at in range(0, n, step)]))
    return out
