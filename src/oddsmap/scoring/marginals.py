# SPDX-License-Identifier: Apache-2.0
"""A map's probabilities where beams need them: block by block, whatever kind of map it is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.forward.beams import BeamCells
from oddsmap.forward.cell_grid import CellField, Window, windows_of
from oddsmap.full_map.full_map import FullMap
from oddsmap.odds import sigmoid
from oddsmap.posterior.belief import Belief
from oddsmap.posterior.count_view import CountView

__all__ = ["Marginals"]


class Marginals:
    """p(occupied) of the cells that beams meet; the prior of those never observed.

    A full map has beliefs of unobserved cells as well, which are its prior's on neighbours: they
    drift, and are not asked.

    Args:
        belief: the map.

    Attributes:
        probability: of the cells numbered so far, shape (cells,).
        prior: likewise, what the map had for them before any reading.
    """

    def __init__(self, belief: Belief) -> None:
        self._belief = belief
        self._field = CellField(belief.ndim, 0)
        index, log_odds = belief.known_log_odds()
        block = index // self._field.side
        order = np.lexsort(block.T)
        self._index, self._log_odds = index[order], log_odds[order]
        blocks, first = np.unique(block[order][:, ::-1], axis=0, return_index=True)
        ends = np.append(first, len(order))[1:]
        self._known = {
            tuple(at): (int(begin), int(end))
            for at, begin, end in zip(blocks[:, ::-1].tolist(), first, ends, strict=True)
        }
        self.probability: FloatArray = np.empty(0)
        self.prior: FloatArray = np.empty(0)

    def windows(self, origins: FloatArray, reach: float) -> Iterator[tuple[slice, Window]]:
        """Boxes of cells in which beams' cells are listed, see `windows_of`."""
        return windows_of(self._field, origins, reach)

    def number(self, window: Window, listed: BeamCells) -> npt.NDArray[np.int32]:
        """Numbers of cells listed in a window; `probability` and `prior` grow to hold them."""
        numbers = window.number(listed.cells)
        side, cells = self._field.side, self._field.block_cells
        place = np.arange(cells)
        within = np.stack(np.unravel_index(place, (side,) * self._field.ndim)[::-1], axis=1)
        strides = side ** np.arange(self._field.ndim)
        probability, prior = [self.probability], [self.prior]
        for at in self._field.coords[len(self.probability) // cells :]:
            log_odds = _prior(self._belief, at * side + within)
            prior.append(sigmoid(log_odds))
            begin, end = self._known.get(tuple(at.tolist()), (0, 0))
            where = (self._index[begin:end] - at * side) @ strides
            log_odds[where] = self._log_odds[begin:end]
            probability.append(sigmoid(log_odds))
        self.probability, self.prior = np.concatenate(probability), np.concatenate(prior)
        return numbers


def _prior(belief: Belief, index: IntArray) -> FloatArray:
    if isinstance(belief, CountView):
        return np.array(belief.prior_at(index))
    if isinstance(belief, FullMap):
        return np.full(len(index), belief.prior_log_odds)
    return np.zeros(len(index))
