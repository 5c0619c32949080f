# SPDX-License-Identifier: Apache-2.0
"""How many cells have which whole votes, straight from the bytes of tiles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.units import HITS, PASSES
from oddsmap.kernels.vote.tiles import TILE_COUNT, TileArrays

__all__ = ["tabulate_classes", "tabulate_pairs"]


@borrowing
def tabulate_pairs(tiles: TileArrays, table: npt.NDArray[np.int64]) -> None:
    """Count the cells of tiles without a wide row by their hits and passes.

    Args:
        tiles: the tiles.
        table: added to, at 256 * hits + passes [votes], shape (65536,); cells with neither count
            at 0.
    """
    for slot in range(tiles.counts[TILE_COUNT]):
        if tiles.wide_of[slot] >= 0:
            continue
        narrow = tiles.narrow[slot]
        for cell in range(narrow.shape[1]):
            h, p = narrow[HITS, np.uint64(cell)], narrow[PASSES, np.uint64(cell)]
            table[(np.uint64(h) << np.uint64(8)) | np.uint64(p)] += 1


@borrowing
def tabulate_classes(
    tiles: TileArrays, first: int, codes: npt.NDArray[np.uint8], table: npt.NDArray[np.int64]
) -> None:
    """Count the cells of some tiles by their class as well; those with a wide row are left out.

    Args:
        tiles: the tiles.
        first: the slot of the first of them; the others follow it.
        codes: the classes of their cells, shape (n, cells of a tile).
        table: added to, shape (classes, 65536); a class's row is as in `tabulate_pairs`.
    """
    for i in range(codes.shape[0]):
        slot = first + i
        if tiles.wide_of[slot] >= 0:
            continue
        narrow = tiles.narrow[slot]
        for cell in range(narrow.shape[1]):
            h, p = narrow[HITS, np.uint64(cell)], narrow[PASSES, np.uint64(cell)]
            both = (np.uint64(h) << np.uint64(8)) | np.uint64(p)
            table[np.uint64(codes[i, cell]), both] += 1
