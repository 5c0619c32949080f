# SPDX-License-Identifier: Apache-2.0
"""Calibrated probabilities that also look at what lies around a cell.

A cell's class, of those of `neighbour_codes`, takes the place of the whole map: how reflectivities
are distributed among the cells of its class is what is expected of it, also where no beam entered
it. Such cells stay unobserved, and their states unknown; and more than four cells from all evidence
they have the prior. Of the classes the map's share of occupied cells is the prior's to change:

    l = logit(prior) + log odds(occupied | hits, passes, class) - logit(share among all cells).

It is a function of the counts, as without: merging, saving and the order of readings change no bit.
Classes are worked out a tile at a time, whenever they are needed; none are kept.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.cell_index import cell_indices
from oddsmap.evidence.evidence import Evidence
from oddsmap.kernels.units import ONE
from oddsmap.map_files.fields import OfLogOdds, PlanePart
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.odds import Thresholds, logit, sigmoid
from oddsmap.posterior.belief import Belief
from oddsmap.posterior.calibrated import LEVEL, Calibrated
from oddsmap.posterior.count_view import CountView
from oddsmap.posterior.neighbour_codes import NOTHING_SEEN, TileCodes
from oddsmap.posterior.neighbour_model import NeighbourModel, fit_neighbours
from oddsmap.posterior.neighbour_reflection import NeighbourReflection
from oddsmap.posterior.prior import MapLike
from oddsmap.posterior.reflection import Reflection
from oddsmap.posterior.reflectivity import beta_mean
from oddsmap.posterior.tile_leaves import OfCells
from oddsmap.posterior.tile_marks import Marks
from oddsmap.posterior.vote_table import VoteTable
from oddsmap.query.obstacles import Watch

__all__ = ["NeighbourView"]

Codes = npt.NDArray[np.uint8]
Rows = tuple[IntArray, IntArray, IntArray, Codes]
"""Cells: index, shape (n, d), units of hits and of passes, and classes, shape (n,) each."""

# Tiles whose cells without evidence are listed at a time.
_TILES = 64


class NeighbourView(Calibrated):
    """p(occupied) and reflectivity of each cell, by its counts and by those around it.

    Regions as in `Belief`; known cells are those with evidence.

    Args:
        evidence: the map; what is added to it later shows, as in `Calibrated`.

    Other Args:
        prior: as in `Calibrated`, and likewise thresholds and clamp.
        thresholds: see there.
        clamp: see there.
        neighbours: what was fitted to another map, to be used for this one; None: fitted to this.

    Attributes:
        model: what was fitted to all cells alike.
        neighbours: what cells are like, by what lies around them.
        reflectivity: how often a beam is reflected, with a prior that differs likewise.

    Raises:
        ConfigError, InputError: as in `LogOdds`.
    """

    def __init__(
        self,
        evidence: Evidence,
        *,
        prior: float | MapLike | None = None,
        thresholds: Thresholds | None = None,
        clamp: tuple[float, float] | None = None,
        neighbours: NeighbourModel | None = None,
    ) -> None:
        self._given = neighbours
        model = None if neighbours is None else neighbours.occupancy[NOTHING_SEEN]
        super().__init__(evidence, prior=prior, thresholds=thresholds, clamp=clamp, model=model)

    def _reflection(self, beta: tuple[float, float]) -> Reflection:
        self.neighbours = self._given or fit_neighbours(self.evidence, self.model, beta)
        priors = self.neighbours.reflectivity
        self._reflectivity_of = NeighbourReflection(self.evidence, priors, LEVEL)
        return self._reflectivity_of

    def log_odds_at(self, index: npt.ArrayLike) -> FloatArray:
        """Log odds of single cells, shape (n,): see `CountView.log_odds_at`."""
        cells = cell_indices(index, self.ndim)
        hits, passes = self.evidence.tiles.at(cells)
        found: FloatArray = self._of_cells(np.asarray)(hits, passes, partial(np.asarray, cells))
        return found

    def log_odds(self, region: Region | None = None) -> FloatArray:
        """Log odds of a region's cells, of those without evidence by what lies around them."""
        lo, hi = self._region(region)
        hits, passes = self.evidence.region_units(lo, hi)
        codes = TileCodes(self.evidence.tiles).region(lo, hi)
        prior = None if self.prior_map is None else self.prior_map.region(lo, hi).ravel()
        flat = self._of_classes(np.asarray)(hits.ravel(), passes.ravel(), codes.ravel(), prior)
        return flat.reshape(hits.shape)

    def part(self, region: Region) -> PlanePart:
        """A region's cells as files take them: see `Belief.part`."""
        hits, passes = self.evidence.region(*self._region(region))
        return PlanePart(self.probability(region), self.observed(region), hits, passes)

    def to_probability_map(self, region: Region | None = None) -> ProbabilityMap:
        """Probabilities with their place in the world: see `Belief.to_probability_map`."""
        return Belief.to_probability_map(self, region)

    def known_log_odds(self) -> tuple[IntArray, FloatArray]:
        """The cells with evidence: index, shape (n, d), x first, and log odds, shape (n,)."""
        index, hits, passes = self.evidence.cells()
        return index, self._of_cells(np.asarray)(hits, passes, partial(np.asarray, index))

    def save_npz(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write cells as `Calibrated` does, and then those without evidence that are near it.

        These have no hits and passes, are not `observed`, and come in the order of their tiles.
        """
        from oddsmap.map_files.npz import Column, save_npz

        count = sum(len(index) for index, _, _ in self.evidence.tiles.parts())
        count += sum(len(rows[0]) for rows in self._unseen())

        def column(values: Callable[[Rows], npt.NDArray[Any]], *more: int) -> Column:
            return Column((count, *more), lambda: map(values, self._listed()))

        p_of = self._of_classes(sigmoid)

        def probability(rows: Rows) -> FloatArray:
            prior = None if self.prior_map is None else self.prior_map.at(rows[0])
            return p_of(*rows[1:], prior)

        save_npz(
            Path(path),
            index=column(lambda rows: rows[0], self.ndim),
            hits=column(lambda rows: rows[1] / ONE),
            passes=column(lambda rows: rows[2] / ONE),
            probability=column(probability),
            observed=column(lambda rows: (rows[1] | rows[2]) > 0),
            resolution=self.resolution,
            extra={
                "reflectivity": column(lambda rows: beta_mean(*self._beta(rows))),
                "reflectivity_low": column(lambda rows: self._interval(rows)[0]),
                "reflectivity_high": column(lambda rows: self._interval(rows)[1]),
            },
            force=force,
        )

    def _beta(self, rows: Rows) -> tuple[FloatArray, FloatArray]:
        return self._reflectivity_of.with_priors(*rows[1:])

    def _interval(self, rows: Rows) -> FloatArray:
        return self.reflectivity.intervals(*self._beta(rows))

    def _listed(self) -> Iterator[Rows]:
        """The cells with evidence, some at a time, and then those that are near some."""
        codes = TileCodes(self.evidence.tiles)
        for index, hits, passes in self.evidence.tiles.parts():
            yield index, hits, passes, codes.at(index)
        yield from self._unseen()

    def _unseen(self) -> Iterator[Rows]:
        """The cells without evidence that are near some."""
        tiles = self.evidence.tiles
        classes, d = TileCodes(tiles), self.ndim
        near = classes.near()
        for start in range(0, len(near), _TILES):
            coords = near[start : start + _TILES]
            codes = classes.of_tiles(coords)
            which, place = np.nonzero(codes != NOTHING_SEEN)
            inside = np.stack(np.unravel_index(place, (tiles.side,) * d)[::-1], axis=1)
            index = coords[which] * tiles.side + inside
            hits, passes = tiles.at(index)
            empty = (hits | passes) == 0
            yield index[empty], hits[empty], passes[empty], codes[which, place][empty]

    def _state_marks(self, marks: Marks, thresholds: Thresholds | None, within: Region) -> Marks:
        return super(CountView, self)._state_marks(marks, thresholds, within)

    def _watch(self, within: Region | None) -> Watch | None:
        return None  # a cell's state changes with votes in other cells

    def _settings(self) -> tuple[object, ...]:
        return (*super()._settings(), self.neighbours)

    def _of_cells(self, function: OfLogOdds) -> OfCells:
        codes, of_classes = TileCodes(self.evidence.tiles), self._of_classes(function)

        def of_cells(
            hits: IntArray, passes: IntArray, index: Callable[[], IntArray]
        ) -> npt.NDArray[Any]:
            cells = index()
            prior = None if self.prior_map is None else self.prior_map.at(cells)
            return of_classes(hits, passes, codes.at(cells), prior)

        return of_cells

    def _of_classes(
        self, function: OfLogOdds
    ) -> Callable[[IntArray, IntArray, Codes, FloatArray | None], npt.NDArray[Any]]:
        """A function of log odds as one of units, classes and the prior's log odds, (n,) each."""
        uniform, tables = float(logit(self.prior)), dict[int, VoteTable]()

        def alone(code: int, hits: FloatArray, passes: FloatArray) -> FloatArray:
            model = self.neighbours.occupancy[code]
            return model.log_odds(hits, passes) - self.model.prior_log_odds

        def whole(code: int, hits: FloatArray, passes: FloatArray) -> npt.NDArray[Any]:
            return function(self._clamped(uniform + alone(code, hits, passes)))

        def of_classes(
            hits: IntArray, passes: IntArray, codes: Codes, prior: FloatArray | None
        ) -> npt.NDArray[Any]:
            values = np.empty(len(hits))
            for code in np.unique(codes).tolist():
                if code not in tables:
                    tables[code] = VoteTable(partial(whole if prior is None else alone, code))
                chosen = codes == code
                values[chosen] = tables[code](hits[chosen], passes[chosen])
            return values if prior is None else function(self._clamped(prior + values))

        return of_classes
