# SPDX-License-Identifier: Apache-2.0
"""The reflection map: how often a cell returns the beams that reach it.

Each cell has a reflectivity m, the chance that a beam which reaches it ends there. Of n = hits +
passes beams that reached it, hits is binomial in m, and with a Beta(a, b) prior the posterior is

    m | z ~ Beta(a + hits, b + passes)

in closed form, cells independent of each other. It tells glass and leaves (m between 0 and 1)
from cells that were seldom seen (a wide interval), which one probability of being occupied cannot.
Fractional weights are fractional counts.

Source: Haehnel, Triebel, Burgard, Thrun: Map building with mobile robots in dynamic environments
(2003), section II (counting); Luft, Schaefer, Schubert, Burgard: Closed-form full map posteriors
for robot localization with lidar sensors (2017), section III-A (the Beta posterior).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.lookup import units_at
from oddsmap.evidence.overview import overview_of
from oddsmap.kernels.units import ONE
from oddsmap.plot.thumbnail import MOST_PIXELS, Thumbnail, of_hits, of_quantity
from oddsmap.posterior.reflectivity import (
    BetaView,
    IntervalKind,
    Quantity,
    Table,
    beta_mean,
    beta_std,
)
from oddsmap.posterior.vote_table import VoteTable

__all__ = ["IntervalKind", "Quantity", "Reflection"]

# Cells whose intervals are worked out together, once for each pair of counts among them.
_FEW = 1 << 20
_VALUES = np.dtype([(name, np.float32) for name in ("mean", "std", "lower", "upper")])


class Reflection(BetaView):
    """p(reflectivity | z_1:t) of each cell, a Beta distribution.

    Regions are pairs (lo, hi) of cell indices, x first, hi past the last cell; by default the
    box of known cells. Arrays have shape (ny, nx), row = y ascending; (nz, ny, nx) in 3D. Cells
    without evidence have the values of the Beta(a, b) prior.

    Args:
        evidence: the map, of `votes="beam"`; what is added to it later shows in the view. With
            `votes="scan"` there is a warning: hits win within a scan, so that a cell hit by one of
            three beams counts as hit by all.

    Other Args:
        a: the prior's weight of hits [votes], above 0; a = b = 1 is uniform.
        b: its weight of passes [votes], above 0.
        threshold: reflectivity that tells occupied from free.
        level: mass of the credible interval.
        kind: "equal-tailed" or "highest-density" (the shortest): see
            `oddsmap.posterior.beta.beta_interval`.

    Raises:
        ConfigError: a value is outside its range.
    """

    def _thumbnail(self) -> Thumbnail | None:
        seen = overview_of(self.evidence.tiles, MOST_PIXELS)
        if seen is None:
            return None
        known = (seen.hits > 0.0) | (seen.passes > 0.0)
        if self.ndim == 3:
            return of_hits(seen.hits, known)
        mean = beta_mean(self.a + seen.hits, self.b + seen.passes)
        return of_quantity(np.where(known, mean, np.nan), "mean reflectivity", (0.0, 1.0))

    def _facts(self) -> Iterator[str]:
        yield from self.evidence.place_facts()
        yield from self._settings_facts()

    def __init__(
        self,
        evidence: Evidence,
        *,
        a: float = 1.0,
        b: float = 1.0,
        threshold: float = 0.5,
        level: float = 0.95,
        kind: IntervalKind = "equal-tailed",
    ) -> None:
        super().__init__(a=a, b=b, threshold=threshold, level=level, kind=kind)
        if evidence.sensor.kind == "cone":
            warnings.warn(
                "counting does badly under wide beams, whose hits belong to one cell of many: "
                "oddsmap.build_reflection_map estimates reflectivity from the log",
                stacklevel=2,
            )
        if evidence.votes == "scan" and evidence.sensor.kind == "beam":
            warnings.warn(
                'reflectivity from a map of votes="scan" is too high, as hits win within a scan; '
                'build the map with votes="beam"',
                stacklevel=2,
            )
        self.evidence = evidence

    @property
    def ndim(self) -> int:
        """2 for a 2D map, 3 for a 3D map."""
        return self.evidence.ndim

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""
        return self.evidence.resolution

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of cells with evidence: first index and past the last, shape (d,)."""
        return self.evidence.bounds()

    def parameters(self, region: Region | None = None) -> tuple[FloatArray, FloatArray]:
        """Alpha = a + hits and beta = b + passes of a region's cells."""
        hits, passes = self.evidence.region_units(*self._region(region))
        return self.a + hits / ONE, self.b + passes / ONE

    def parameters_at(
        self, index: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """Alpha and beta of single cells, and whether they have evidence: see `BetaView`."""
        hits, passes = units_at(self.evidence, index)
        return self.a + hits / ONE, self.b + passes / ONE, (hits | passes) > 0

    def observed(self, region: Region | None = None) -> npt.NDArray[np.bool_]:
        """True where a region's cells have any evidence."""
        hits, passes = self.evidence.region_units(*self._region(region))
        return (hits > 0) | (passes > 0)

    def cells(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """The cells with evidence, in order of their index, x changing fastest.

        Returns:
            index, shape (n, d), x first; the posterior's alpha = a + hits and beta = b + passes,
            shape (n,).
        """
        index, hits, passes = self.evidence.cells()
        return index, self.a + hits / ONE, self.b + passes / ONE

    def _counts(self) -> tuple[FloatArray, FloatArray]:
        _, hits, passes = self.evidence.cells()
        return hits / ONE, passes / ONE

    def _table(self) -> Table:
        """As the base class has it; of large maps, made of some cells at a time."""
        from oddsmap.map_files.npz import Column

        tiles, count = self.evidence.tiles, self.evidence.cell_count()
        if count <= _FEW:
            return super()._table()
        table = VoteTable(self._values)

        def values(name: str) -> Column:
            return Column((count,), lambda: (table(h, p)[name] for _, h, p in tiles.parts()))

        return (
            Column((count, self.ndim), lambda: (index for index, _, _ in tiles.parts())),
            Column((count,), lambda: (hits / ONE for _, hits, _ in tiles.parts())),
            Column((count,), lambda: (passes / ONE for _, _, passes in tiles.parts())),
            {name: values(name) for name in _VALUES.names or ()},
        )

    def _values(self, hits: FloatArray, passes: FloatArray) -> npt.NDArray[np.void]:
        alpha, beta = self.a + hits, self.b + passes
        values = np.empty(len(hits), _VALUES)
        values["mean"], values["std"] = beta_mean(alpha, beta), beta_std(alpha, beta)
        values["lower"], values["upper"] = self.intervals(alpha, beta)
        return values
