# SPDX-License-Identifier: Apache-2.0
"""What a careful person writes with NumPy alone: one scan at a time, all of its beams at once.

The same cells as oddsmap by the same rules (a hit for the end point's cell, a pass for every other
cell with positive length inside it, at most one vote a cell and scan, hits first), in plain double
precision and into a dense grid that is made as large as needed beforehand. Where a beam runs
through a corner, rounding may differ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["DenseMap", "add_scan", "passed_cells"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(slots=True)
class DenseMap:
    """Votes of a box of cells; row 0 is the lowest y.

    Args:
        resolution: side of a cell [m].
        first: index (ix, iy) of the lower left cell, shape (2,).
        shape: rows and columns.
    """

    resolution: float
    first: IntArray
    shape: tuple[int, int]
    hits: npt.NDArray[np.uint16]
    passes: npt.NDArray[np.uint16]

    @classmethod
    def covering(cls, resolution: float, lo: IntArray, hi: IntArray) -> DenseMap:
        """An empty map of the cells lo <= index < hi."""
        shape = (int(hi[1] - lo[1]), int(hi[0] - lo[0]))
        return cls(resolution, lo, shape, np.zeros(shape, np.uint16), np.zeros(shape, np.uint16))


def add_scan(
    grid: DenseMap,
    origin: FloatArray,
    rotation: FloatArray,
    directions: FloatArray,
    ranges: FloatArray,
) -> None:
    """Add one scan.

    Args:
        grid: changed in place.
        origin: sensor position in the map [m], shape (2,).
        rotation: map_from_sensor, shape (2, 2).
        directions: unit vectors in the sensor frame, shape (n, 2).
        ranges: [m], shape (n,); readings that are not finite are left out.
    """
    seen = np.isfinite(ranges)
    ends = origin + (directions[seen] @ rotation.T) * ranges[seen, None]
    start, ends = origin / grid.resolution, ends / grid.resolution
    columns = grid.shape[1]
    end_cells = np.floor(ends).astype(np.int64) - grid.first
    hit = end_cells[:, 1] * columns + end_cells[:, 0]
    cells = passed_cells(start, ends) - grid.first
    free = cells[:, 1] * columns + cells[:, 0]
    # Repeats do not matter in an assignment with one value: one vote a cell and scan. The part of
    # the grid that the scan reaches is all that is looked at.
    top = int(max(hit.max(initial=0), free.max(initial=0))) + 1
    bottom = int(min(hit.min(initial=top), free.min(initial=top)))
    marks = np.zeros(top - bottom, np.uint8)
    marks[free - bottom] = 1
    marks[hit - bottom] = 2
    grid.passes.ravel()[bottom:top] += marks == 1
    grid.hits.ravel()[bottom:top] += marks == 2


def passed_cells(start: FloatArray, ends: FloatArray) -> IntArray:
    """Cells with positive length of the segments from a start point, with repeats.

    Along the longer axis of a segment each row of cells is one slab, in which the other coordinate
    moves by one cell at most: so the cells at the slab's two ends are all of it.

    Args:
        start: [cells], shape (2,).
        ends: [cells], shape (n, 2).

    Returns:
        Indices, shape (m, 2), without the cells of the end points.
    """
    way = ends - start
    beams = np.arange(len(ends))
    major = (np.abs(way[:, 1]) > np.abs(way[:, 0])).astype(np.int64)
    a0, b0 = start[major], start[1 - major]
    a1, b1 = ends[beams, major], ends[beams, 1 - major]
    length = a1 - a0
    slope = np.divide(b1 - b0, length, out=np.zeros_like(length), where=length != 0)
    low, high = np.minimum(a0, a1), np.maximum(a0, a1)
    first = np.floor(low).astype(np.int64)
    slabs = np.ceil(high).astype(np.int64) - first

    beam = np.repeat(beams, slabs)
    slab = np.arange(len(beam)) - np.repeat(np.cumsum(slabs) - slabs, slabs) + first[beam]
    enter = np.maximum(slab, low[beam]) - a0[beam]
    leave = np.minimum(slab + 1, high[beam]) - a0[beam]
    one = b0[beam] + slope[beam] * enter
    other = b0[beam] + slope[beam] * leave
    lower = np.floor(np.minimum(one, other)).astype(np.int64)
    upper = np.maximum(np.ceil(np.maximum(one, other)).astype(np.int64) - 1, lower)
    second = upper > lower

    a = np.concatenate([slab, slab[second]])
    b = np.concatenate([lower, upper[second]])
    beam = np.concatenate([beam, beam[second]])
    across = major[beam] == 1
    cells = np.stack([np.where(across, b, a), np.where(across, a, b)], axis=1)
    kept: IntArray = cells[(cells != np.floor(ends[beam]).astype(np.int64)).any(axis=1)]
    return kept
