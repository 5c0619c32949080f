# SPDX-License-Identifier: Apache-2.0
"""Classes of cells by what lies around them, worked out a tile at a time.

Around a cell lie those up to four cells away along each axis, and each weighs 1 / 2^steps. Two
sums over them are all that is looked at: how much was hit, and how much was seen. A cell with n
votes, h of them hits, is seen by n / (n + 1) and hit by h / (n + 1), so that many beams in one cell
say no more than one cell can. The cell itself is left out: what is learnt of cells by their
classes is never learnt from their own counts.

Its own beam, though, has seen others on its way, and fewer of them where it ended in the cell.
Along an axis that is .13 of all there is to see around a cell of the plane, .04 in space. Classes
that told apart such sums would tell hits by their lack of passes: where so little is seen that no
beam can have passed through, all known cells are hits. So the first class of a row reaches up to
.25 in the plane, and to .12 in space.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.evidence.tiles import TileStore, distinct_rows
from oddsmap.kernels.query.neighbours import REACH, classify_neighbours

__all__ = ["NOTHING_SEEN", "Codes", "TileCodes", "class_count", "row_count"]

Codes = npt.NDArray[np.uint8]

NOTHING_SEEN = 0
"""The class of cells around which nothing was seen."""

# Of hits: in cells that touch the one in question and whose every beam is a hit, where two make 1.
_HIT_EDGES = (0.003, 0.01, 0.03, 0.1, 0.25, 0.5, 1.0, 2.0)
# Of what was seen: as a share of all there is.
_SEEN_EDGES = {2: (0.25, 0.5, 0.75), 3: (0.12, 0.25, 0.5, 0.75)}
_WEIGHT_OF_CELL, _WEIGHT_OF_ROW = 16, 46  # of itself, and of all nine along an axis
_STEPS = 256


def row_count() -> int:
    """How many classes there are by hits."""
    return len(_HIT_EDGES) + 1


def class_count(ndim: int) -> int:
    """How many classes there are, without that of cells around which nothing was seen."""
    return row_count() * (len(_SEEN_EDGES[ndim]) + 1)


class TileCodes:
    """Classes of the cells of a map, for as long as that does not change.

    Tiles that have been asked for are kept until cells are that lie beyond them along the last
    axis: cells in order of their index, as `TileStore.parts` gives them, need each tile once.

    Args:
        tiles: the map's.
    """

    def __init__(self, tiles: TileStore) -> None:
        self._tiles = tiles
        d, side = tiles.ndim, tiles.side
        own = _STEPS * _WEIGHT_OF_CELL**d
        others = _STEPS * _WEIGHT_OF_ROW**d - own
        self._hit_edges = np.array([math.ceil(edge * own) for edge in _HIT_EDGES])
        self._seen_edges = np.array([math.ceil(edge * others) for edge in _SEEN_EDGES[d]])
        layers = side + 2 * REACH if d == 3 else 1
        shape = (2, layers, side + 2 * REACH, side + 2 * REACH)
        self._rooms = np.zeros(d, np.int64), np.zeros(shape, np.int32), np.zeros(shape, np.int32)
        self._rows: dict[tuple[int, ...], Codes] = {}

    def of_tiles(self, coords: IntArray) -> Codes:
        """The classes of tiles' cells, shape (n, cells of a tile); coords has shape (n, d)."""
        codes = np.empty((len(coords), self._tiles.side**self._tiles.ndim), np.uint8)
        classify_neighbours(
            self._tiles.arrays, self._tiles.side, np.ascontiguousarray(coords),
            self._hit_edges, self._seen_edges, *self._rooms, codes,
        )  # fmt: skip
        return codes

    def at(self, index: IntArray) -> Codes:
        """The classes of cells, shape (n,); index has shape (n, d), x first."""
        if len(index) == 0:
            return np.empty(0, np.uint8)
        side, d = self._tiles.side, self._tiles.ndim
        coords, which = distinct_rows(index // side)
        keys = list(map(tuple, coords.tolist()))
        new = [n for n, key in enumerate(keys) if key not in self._rows]
        self._rows.update(zip((keys[n] for n in new), self.of_tiles(coords[new]), strict=True))
        place = np.ravel_multi_index(tuple((index % side).T[::-1]), (side,) * d)
        codes: Codes = np.stack([self._rows[key] for key in keys])[which, place]
        lowest = coords[:, -1].min()
        self._rows = {key: row for key, row in self._rows.items() if key[-1] >= lowest}
        return codes

    def region(self, lo: IntArray, hi: IntArray) -> Codes:
        """The classes of a box of cells, shape (ny, nx) or (nz, ny, nx); hi past the last."""
        side = self._tiles.side
        first, past = lo // side, -(-hi // side)
        codes = np.zeros([int(n) for n in (hi - lo)[::-1]], np.uint8)
        for tile in self._near(first, past):
            begin = np.maximum(tile * side, lo)
            end = np.minimum((tile + 1) * side, hi)
            block = self.of_tiles(tile[None]).reshape((side,) * self._tiles.ndim)
            inside, there = (
                tuple(
                    slice(a, b)
                    for a, b in zip(*(x[::-1] for x in (begin - o, end - o)), strict=True)
                )
                for o in (tile * side, lo)
            )
            codes[there] = block[inside]
        return codes

    def near(self) -> IntArray:
        """Tiles with evidence and those around them, shape (n, d), the last axis slowest."""
        d = self._tiles.ndim
        far = np.full(d, 1 << 62)
        return self._near(-far, far)

    def _near(self, first: IntArray, past: IntArray) -> IntArray:
        d, far = self._tiles.ndim, -(-REACH // self._tiles.side)
        steps = np.indices((2 * far + 1,) * d).reshape(d, -1).T - far
        coords = self._tiles.coords
        around = (coords >= first - far) & (coords < past + far)
        coords = coords[around.all(axis=1)]
        found = np.unique((coords[:, None] + steps).reshape(-1, d)[:, ::-1], axis=0)[:, ::-1]
        inside = ((found >= first) & (found < past)).all(axis=1)
        return np.ascontiguousarray(found[inside])
