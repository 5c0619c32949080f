# SPDX-License-Identifier: Apache-2.0
"""The cells of a 3D map in the order of an octree, some at a time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.evidence.tiles import PART, TileStore
from oddsmap.kernels.vote.tile_listing import list_codes
from oddsmap.map_files.morton import morton, unmorton

__all__ = ["has_octree_order", "octree_parts"]


def has_octree_order(tiles: TileStore, base: IntArray) -> bool:
    """Whether tiles are nodes of an octree: their sides are powers of two, and it begins at one."""
    power = tiles.side & (tiles.side - 1) == 0
    return tiles.ndim == 3 and power and not (base % tiles.side).any()


def octree_parts(
    tiles: TileStore, base: IntArray, most: int = PART
) -> Iterator[tuple[IntArray, IntArray, IntArray]]:
    """The cells with a weight in the order of their Morton codes.

    Args:
        tiles: nodes of the octree, see `has_octree_order`.
        base: the cell of code 0; all tiles lie within 2^21 cells from there, along each axis.
        most: how many cells at a time, and no more than the cells of a tile beyond that.

    Yields:
        Codes, units of hits and of passes, shape (n,) each.
    """
    side = tiles.side
    first = morton(tiles.coords * side - base)
    order = np.argsort(first)
    first = first[order]
    x, y, z = unmorton(np.arange(side**3)).T
    inside = (z * side + y) * side + x
    room, at = most + side**3, np.zeros(1, np.int64)
    while at[0] < len(order):
        code, hits, passes = (np.empty(room, np.int64) for _ in range(3))
        found = list_codes(tiles.arrays, order, first, inside, at, code, hits, passes)
        if found:
            yield code[:found], hits[:found], passes[:found]
