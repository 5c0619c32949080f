# SPDX-License-Identifier: Apache-2.0
"""How the cells of a map are drawn in turn, under either prior: one sweep after another."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.full_map.factor_graph import FactorGraph, State, begin
from oddsmap.full_map.window_prior import Windows

__all__ = ["Chain", "chain_of"]

# A cell that the burn-in found free or occupied to within _SURE is drawn in every _SELDOM-th sweep.
_SURE, _SELDOM = 1e-3, 5


class Chain(Protocol):
    """A map that is drawn anew cell by cell.

    Attributes:
        state: the map, 1 where occupied, shape (cells,).
    """

    state: State

    def sweep(self, total: FloatArray) -> int:
        """Draw cells once in turn; each one's last probability is added to total, (cells,).

        Returns:
            How many cells were turned over.
        """

    def settle(self, mean: FloatArray) -> None:
        """Take note of what the burn-in found, the mean of each cell's probabilities."""


def chain_of(graph: FactorGraph, start: BoolArray | None, seed: int) -> Chain:
    """The chain of a posterior from a map on; the same seed draws the same.

    Raises:
        InputError: a start of another shape.
    """
    if graph.windows is None:
        return _PairChain(graph, start, seed)
    return _WindowChain(graph, graph.windows, start, seed)


class _PairChain:
    """All cells, in the order of their numbers, given their neighbours."""

    def __init__(self, graph: FactorGraph, start: BoolArray | None, seed: int) -> None:
        self._graph = graph
        self._bins, self._of_cells, self.state = begin(graph, start)
        self._rng = np.random.default_rng(seed)

    def sweep(self, total: FloatArray) -> int:
        from oddsmap.kernels.infer.cell_flips import gibbs_sweep

        graph = self._graph
        return gibbs_sweep(
            graph.rows, self._bins, self._of_cells, graph.detection, graph.neighbours, graph.prior,
            float(graph.coupling), self._rng.random(graph.cell_count), self.state, total,
        )  # fmt: skip

    def settle(self, mean: FloatArray) -> None:
        pass


class _WindowChain:
    """The cells that beams are about, given the windows around them; those that are sure, seldom.

    Which cells are sure is settled with the burn-in. From then on the order of drawing is fixed,
    and each draw leaves the posterior as it is: so does the whole.
    """

    def __init__(
        self, graph: FactorGraph, windows: Windows, start: BoolArray | None, seed: int
    ) -> None:
        from oddsmap.kernels.infer.window_flips import WindowRows

        self._graph = graph
        if start is not None and start.shape == (graph.cell_count,):
            # All others are free.
            may_be = np.zeros(graph.cell_count, np.bool_)
            may_be[windows.cells] = True
            start = start & may_be
        self._bins, self._of_cells, self.state = begin(graph, start)
        self._rng = np.random.default_rng(seed)
        steps = windows.steps()
        self._windows = WindowRows(windows.cells, windows.around, steps, windows.codes(self.state))
        self._all = np.arange(len(windows.cells))
        self._unsure, self._sweeps = self._all, 0
        self._last = np.zeros(len(windows.cells))

    def sweep(self, total: FloatArray) -> int:
        from oddsmap.kernels.infer.window_flips import draw_windows

        graph = self._graph
        chosen = self._all if self._sweeps % _SELDOM == 0 else self._unsure
        self._sweeps += 1
        flips = draw_windows(
            graph.rows, self._bins, self._of_cells, graph.detection, self._windows, chosen,
            self._rng.random(len(chosen)), self.state, self._last,
        )  # fmt: skip
        total[self._windows.cells] += self._last
        return flips

    def settle(self, mean: FloatArray) -> None:
        p = mean[self._windows.cells]
        self._unsure = np.flatnonzero((p > _SURE) & (p < 1.0 - _SURE))
        self._sweeps = 0
