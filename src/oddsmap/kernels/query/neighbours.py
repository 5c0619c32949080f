# SPDX-License-Identifier: Apache-2.0
"""What lies around each cell of a tile: the weights of its neighbours, and classes of them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.units import FRACTION_BITS, HITS, ONE, PASSES
from oddsmap.kernels.vote.tiles import TileArrays, find

__all__ = ["REACH", "classify_neighbours"]

IntArray = npt.NDArray[np.int64]
Sums = npt.NDArray[np.int32]

REACH = 4
"""How many cells away along each axis a neighbour may be."""


@borrowing
def classify_neighbours(
    tiles: TileArrays,
    side: int,
    coords: IntArray,
    hit_edges: IntArray,
    seen_edges: IntArray,
    key: IntArray,
    wide: Sums,
    narrow: Sums,
    codes: npt.NDArray[np.uint8],
) -> None:
    """Give each cell of some tiles, which need not exist, the class of its neighbours.

    A neighbour weighs 16 / 2^steps along each axis, and counts as seen by n / (n + 1) and as hit by
    h / (n + 1), in 256ths, of n votes with h hits. The cell itself is left out.

    Args:
        tiles: the tiles.
        side: cells along the side of a tile.
        coords: which tiles, shape (n, d), x first.
        hit_edges: sums of hits from which the next row of classes begins, ascending.
        seen_edges: sums of what was seen from which the next class of a row begins, ascending.
        key: room for the coordinates of a tile, shape (d,).
        wide: room for a tile with the cells around it, shape (2, layers, side + 8, side + 8).
        narrow: likewise.
        codes: filled, shape (n, cells of a tile): 0 where nothing around was seen.
    """
    d = coords.shape[1]
    deep = d == 3
    layers = side if deep else 1
    above = REACH if deep else 0
    span = side + 2 * REACH
    own = 256 if d == 2 else 4096
    columns = seen_edges.shape[0] + 1
    for i in range(coords.shape[0]):
        if not _gather(tiles, side, coords[i], key, wide):
            codes[i] = 0
            continue
        for kind in range(2):
            # Along x and y, of every layer; rows that nothing asks for are not filled.
            for z in range(layers + 2 * above):
                for y in range(span):
                    for x in range(side):
                        narrow[kind, z, y, x] = _along(
                            wide[kind, z, y, x], wide[kind, z, y, x + 1], wide[kind, z, y, x + 2],
                            wide[kind, z, y, x + 3], wide[kind, z, y, x + 4],
                            wide[kind, z, y, x + 5], wide[kind, z, y, x + 6],
                            wide[kind, z, y, x + 7], wide[kind, z, y, x + 8],
                        )  # fmt: skip
                for y in range(side):
                    for x in range(side):
                        narrow[kind, z, y, x] = _along(
                            narrow[kind, z, y, x], narrow[kind, z, y + 1, x],
                            narrow[kind, z, y + 2, x], narrow[kind, z, y + 3, x],
                            narrow[kind, z, y + 4, x], narrow[kind, z, y + 5, x],
                            narrow[kind, z, y + 6, x], narrow[kind, z, y + 7, x],
                            narrow[kind, z, y + 8, x],
                        )  # fmt: skip
            if deep:
                for z in range(layers):
                    for y in range(side):
                        for x in range(side):
                            narrow[kind, z, y, x] = _along(
                                narrow[kind, z, y, x], narrow[kind, z + 1, y, x],
                                narrow[kind, z + 2, y, x], narrow[kind, z + 3, y, x],
                                narrow[kind, z + 4, y, x], narrow[kind, z + 5, y, x],
                                narrow[kind, z + 6, y, x], narrow[kind, z + 7, y, x],
                                narrow[kind, z + 8, y, x],
                            )  # fmt: skip
        place = 0
        for z in range(layers):
            for y in range(side):
                for x in range(side):
                    at = (z + above, y + REACH, x + REACH)
                    hit = narrow[0, z, y, x] - own * wide[0, at[0], at[1], at[2]]
                    seen = narrow[1, z, y, x] - own * wide[1, at[0], at[1], at[2]]
                    code = 0
                    if seen > 0:
                        code = 1
                        for edge in hit_edges:
                            code += columns * (hit >= edge)
                        for edge in seen_edges:
                            code += seen >= edge
                    codes[i, place] = code
                    place += 1


@borrowing
def _along(a: int, b: int, c: int, d: int, e: int, f: int, g: int, h: int, i: int) -> int:
    """Nine in a row, each weighing half of the next one towards the middle."""
    return (a + i) + 2 * (b + h) + 4 * (c + g) + 8 * (d + f) + 16 * e


@borrowing
def _gather(tiles: TileArrays, side: int, tile: IntArray, key: IntArray, wide: Sums) -> bool:
    """Put what was hit and seen in a tile and around it in one array; False: nothing there."""
    d = tile.shape[0]
    deep = d == 3
    layers = side if deep else 1
    wide[:] = 0
    found = False
    # A tile of few cells needs more than its next neighbours.
    far = (REACH + side - 1) // side
    for dz in range(-far if deep else 0, far + 1 if deep else 1):
        for dy in range(-far, far + 1):
            for dx in range(-far, far + 1):
                key[0], key[1] = tile[0] + dx, tile[1] + dy
                if deep:
                    key[2] = tile[2] + dz
                slot = find(tiles, key)
                if slot < 0:
                    continue
                found = True
                row = tiles.wide_of[slot]
                for z in range(layers):
                    to_z = z + dz * side + REACH if deep else 0
                    if (to_z < 0) | (to_z >= wide.shape[1]):
                        continue
                    for y in range(side):
                        to_y = y + dy * side + REACH
                        if (to_y < 0) | (to_y >= wide.shape[2]):
                            continue
                        left, right = (
                            max(0, -dx * side - REACH),
                            min(side, side + REACH - dx * side),
                        )
                        cell = (z * side + y) * side
                        for x in range(left, right):
                            h = np.int64(tiles.narrow[slot, HITS, cell + x]) << FRACTION_BITS
                            p = np.int64(tiles.narrow[slot, PASSES, cell + x]) << FRACTION_BITS
                            if row >= 0:
                                h += tiles.wide[row, HITS, cell + x]
                                p += tiles.wide[row, PASSES, cell + x]
                            if h + p > 0:
                                total = np.float64(h + p) + ONE
                                to_x = x + dx * side + REACH
                                wide[0, to_z, to_y, to_x] = np.int32(256.0 * h / total)
                                wide[1, to_z, to_y, to_x] = np.int32(256.0 * (h + p) / total)
    return found
