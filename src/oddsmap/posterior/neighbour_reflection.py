# SPDX-License-Identifier: Apache-2.0
"""The reflection map whose prior in each cell is that of the cells with such neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.cell_index import cell_indices
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.lookup import units_at
from oddsmap.kernels.units import ONE
from oddsmap.odds import Thresholds
from oddsmap.posterior.neighbour_codes import TileCodes
from oddsmap.posterior.reflection import Reflection
from oddsmap.posterior.reflectivity import BetaView, Table
from oddsmap.query.queries import PointStates

__all__ = ["NeighbourReflection"]


class NeighbourReflection(Reflection):
    """p(reflectivity | z_1:t) of each cell, a Beta distribution; also of cells without evidence.

    Args:
        evidence: the map.
        priors: weights of hits and of passes by the class of a cell, see `NeighbourModel`; the
            first is that of cells far from all evidence.
        level: mass of the credible interval.

    Raises:
        ConfigError: a value is outside its range.
    """

    def __init__(
        self, evidence: Evidence, priors: tuple[tuple[float, float], ...], level: float
    ) -> None:
        super().__init__(evidence, a=priors[0][0], b=priors[0][1], level=level)
        self.priors = priors

    def parameters(self, region: Region | None = None) -> tuple[FloatArray, FloatArray]:
        """Alpha and beta of a region's cells: the prior's weights, and hits and passes."""
        lo, hi = self._region(region)
        hits, passes = self.evidence.region_units(lo, hi)
        return self.with_priors(hits, passes, TileCodes(self.evidence.tiles).region(lo, hi))

    def parameters_at(
        self, index: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """Alpha and beta of single cells, and whether they have evidence: see `BetaView`."""
        hits, passes = units_at(self.evidence, index)
        cells = cell_indices(index, self.ndim)
        codes = TileCodes(self.evidence.tiles).at(cells)
        return *self.with_priors(hits, passes, codes), (hits | passes) > 0

    def cells(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """The cells with evidence: see `Reflection.cells`."""
        index, hits, passes = self.evidence.cells()
        return index, *self.with_priors(hits, passes, TileCodes(self.evidence.tiles).at(index))

    def with_priors(
        self, hits: IntArray, passes: IntArray, codes: npt.NDArray[np.uint8]
    ) -> tuple[FloatArray, FloatArray]:
        """Alpha and beta of units of hits and passes and of classes, of one shape."""
        a, b = np.array(self.priors)[codes].T
        return a.T + hits / ONE, b.T + passes / ONE

    def _states_at(self, cells: IntArray, thresholds: Thresholds | None) -> PointStates:
        found = super()._states_at(cells, thresholds)
        hits, passes = self.evidence.tiles.at(cells)
        return replace(found, hits=hits / ONE, passes=passes / ONE)

    def _table(self) -> Table:
        return BetaView._table(self)
