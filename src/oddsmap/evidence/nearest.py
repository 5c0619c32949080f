# SPDX-License-Identifier: Apache-2.0
"""Maps moved by what is no whole number of cells: each cell takes the counts of the nearest.

A cell of the moved map has the hits and passes of the cell that holds its centre, turned back. So
each has the counts of one cell that was seen, as they were: a wall stays as sure as it was, and no
mixture of a wall and the free space before it is made up. The price: in a turn (not in a shift) the
counts of some cells go to two, and those of others to none.
"""

from __future__ import annotations

from itertools import product as combinations
from typing import NamedTuple

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import ONE
from oddsmap.poses.product import product

__all__ = ["Cost", "resampled"]


class Cost(NamedTuple):
    """What moving by no whole number of cells did to the counts."""

    cells: int
    """How many cells had evidence."""
    repeated: int
    """The counts of how many of them went to two cells or more."""
    dropped: int
    """The counts of how many of them went to none."""
    votes_before: float
    """Sum of the hits and passes [votes]."""
    votes: float
    """The same of the moved map."""

    def __str__(self) -> str:
        """For a message."""
        return (
            f"of {self.cells} cells the counts of {self.repeated} are repeated and those of "
            f"{self.dropped} dropped, {self.votes_before:.0f} votes became {self.votes:.0f}"
        )


def resampled(to: TileStore, tiles: TileStore, rotation: FloatArray, shift: FloatArray) -> Cost:
    """Add to an empty store, for each of its cells, the weights of the one that holds its centre.

    Args:
        to: the store that is filled.
        tiles: where the weights come from.
        rotation: from the old frame to the new one, shape (d, d).
        shift: likewise [cells], shape (d,).

    Returns:
        What it cost.

    Raises:
        MapTooLargeError: no memory for the new tiles.
    """
    cells, repeated, dropped, before, after = 0, 0, 0, 0.0, 0.0
    for index, hits, passes in tiles.parts():
        centre = index.astype(np.float64) + 0.5
        near = np.floor(product(centre, rotation.T) + shift).astype(np.int64)
        weights = np.stack([hits, passes], axis=1)
        taken = np.zeros(len(index), np.int64)
        found = []
        # A cell's corners are at most 0.87 from its centre: no cell farther away has its centre in
        # there. Which of these have is asked of each cell alone, so none has it in two cells.
        for step in combinations((-1, 0, 1), repeat=tiles.ndim):
            target = near + np.array(step)
            centre = target.astype(np.float64) + 0.5
            back = np.floor(product(centre - shift, rotation))
            rows = np.flatnonzero((back == index).all(axis=1))
            taken[rows] += 1
            found.append((target[rows], rows))
        targets = np.concatenate([target for target, _ in found])
        rows = np.concatenate([rows for _, rows in found])
        to.add_cells(targets, weights[rows])
        cells += len(index)
        repeated += int(np.count_nonzero(taken > 1))
        dropped += int(np.count_nonzero(taken == 0))
        before += float(weights.sum(dtype=np.float64))  # as whole numbers it may not fit 64 bits
        after += float(weights[rows].sum(dtype=np.float64))
    return Cost(cells, repeated, dropped, before / ONE, after / ONE)
