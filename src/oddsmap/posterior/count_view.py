# SPDX-License-Identifier: Apache-2.0
"""Views of evidence whose log odds are the prior's and a function of a cell's hits and passes.

What that function is, is the view's: a sum of fixed terms (`LogOdds`), or the Bayes factor of two
kinds of cells (`Calibrated`). It is worked out once for each pair of counts, and any prior goes
with it.
"""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.cell_index import cell_indices, check_room
from oddsmap.errors import ConfigError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.lookup import units_at
from oddsmap.evidence.octree_order import has_octree_order
from oddsmap.evidence.overview import overview_of
from oddsmap.evidence.tile_watch import TileWatch
from oddsmap.kernels.units import ONE
from oddsmap.map_files.fields import Leaves, OfLogOdds, PlanePart, PointPart
from oddsmap.map_files.octomap_range import HALF, Shift
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.odds import Thresholds, decided_by, logit, sigmoid
from oddsmap.plot.thumbnail import MOST_PIXELS, Thumbnail, of_hits, of_probability
from oddsmap.posterior.belief import Belief
from oddsmap.posterior.prior import PriorMap, PriorSource
from oddsmap.posterior.tile_leaves import OfCells, TileLeaves
from oddsmap.posterior.tile_marks import WHOLE_VOTES, Marks, marks_of_box
from oddsmap.posterior.vote_table import VoteTable
from oddsmap.query.obstacles import Watch
from oddsmap.query.queries import PointStates

if TYPE_CHECKING:
    from oddsmap.map_files.npz import Column

__all__ = ["CountView", "CountWatch"]

# A thumbnail of more cells is one of the sums of their evidence: decoding takes 40 ns for each.
_SHRUNK_CELLS = 1 << 24
# What a plane takes a cell: 9 bytes itself, the rest where a file is made of it.
_PLANE_BYTES = 32


class CountView(Belief):
    """p(m | z_1:t) of each cell, cells independent of each other.

    Regions as in `Belief`; known cells are those with evidence.

    Args:
        evidence: the map; what is added to it later shows in the view.
        prior: p(x) of every cell, or a map of it, the cells that it does not know having the
            configuration's; default: the map's configuration.
        thresholds: the probabilities from which a cell counts as free or occupied; likewise.
        clamp: lowest and highest probability of this view, None: as they are.

    Attributes:
        prior: p(x) of cells that no prior map knows.
        prior_map: the prior map; None where all cells have `prior`.

    Raises:
        ConfigError: a probability is outside its range.
        InputError: the prior map does not fit.
    """

    def _thumbnail(self) -> Thumbnail | None:
        tiles = self.evidence.tiles
        small = tiles.count * tiles.side**2 <= _SHRUNK_CELLS or self.prior_map is not None
        seen = None if self.ndim == 2 and small else overview_of(tiles, MOST_PIXELS)
        if seen is None:
            return super()._thumbnail()
        known = (seen.hits > 0.0) | (seen.passes > 0.0)
        if self.ndim == 3:
            return of_hits(seen.hits, known)
        p = sigmoid(self.of_votes(seen.hits, seen.passes))
        return of_probability(np.where(known, p, np.nan), of=f"sums of {seen.block}² cells")

    def _facts(self) -> Iterator[str]:
        yield from self.evidence.place_facts()
        yield f"prior {self.prior:.4g}" + ("" if self.prior_map is None else " and a map")
        yield f"free to {self.thresholds.free:g}, occupied from {self.thresholds.occupied:g}"
        if self.clamp is not None:
            yield f"clamped to {self.clamp[0]:g}..{self.clamp[1]:g}"

    def __init__(
        self,
        evidence: Evidence,
        *,
        prior: float | PriorSource | None = None,
        thresholds: Thresholds | None = None,
        clamp: tuple[float, float] | None = None,
    ) -> None:
        self.evidence = evidence
        self.prior = evidence.config.posterior.prior
        if isinstance(prior, int | float | np.number):
            self.prior, prior = float(prior), None
        self.thresholds = decided_by(thresholds, evidence.config.posterior.thresholds)
        if not 0.0 < self.prior < 1.0:
            raise ConfigError(f"prior is a probability between 0 and 1, got {self.prior}")
        if clamp is not None and not 0.0 < clamp[0] < clamp[1] < 1.0:
            raise ConfigError(
                f"clamp needs probabilities 0 < low < high < 1, got {clamp[0]} and {clamp[1]}"
            )
        self.clamp = clamp
        self.prior_map = None if prior is None else PriorMap(prior, evidence, self.prior)

    @property
    def ndim(self) -> int:
        """2 for a 2D map, 3 for a 3D map."""
        return self.evidence.ndim

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""
        return self.evidence.resolution

    @abstractmethod
    def increment(self, hits: npt.ArrayLike, passes: npt.ArrayLike) -> FloatArray:
        """What weights of hits and passes [votes] add to the prior's log odds; 0 for none."""

    def of_votes(
        self,
        hits: npt.ArrayLike,
        passes: npt.ArrayLike,
        prior_log_odds: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Log odds of given weights of hits and passes [votes].

        Args:
            hits: weights, any shape.
            passes: weights, of the same shape.
            prior_log_odds: of the cells they belong to; None: those of `prior`, for all.
        """
        prior = logit(self.prior) if prior_log_odds is None else np.asarray(prior_log_odds)
        return self._clamped(np.asarray(prior + self.increment(hits, passes), np.float64))

    def _clamped(self, log_odds: FloatArray) -> FloatArray:
        if self.clamp is None:
            return log_odds
        low, high = logit(self.clamp)
        return np.clip(log_odds, low, high)

    def prior_at(self, index: npt.ArrayLike) -> FloatArray:
        """Log odds of the prior of single cells, shape (n,); index has shape (n, d), x first."""
        cells = cell_indices(index, self.ndim)
        if self.prior_map is None:
            return np.full(len(cells), float(logit(self.prior)))
        return self.prior_map.at(cells)

    def log_odds_at(self, index: npt.ArrayLike) -> FloatArray:
        """Log odds of single cells, wherever they lie.

        Args:
            index: cells, shape (n, d), x first.

        Returns:
            Shape (n,); the prior's where there is no evidence.

        Raises:
            InputError: an index of another shape, or no whole numbers.
        """
        hits, passes = units_at(self.evidence, index)
        return self.of_votes(hits / ONE, passes / ONE, self.prior_at(index))

    def observed_at(self, index: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """True for single cells with any evidence, shape (n,): see `log_odds_at`."""
        hits, passes = units_at(self.evidence, index)
        return (hits > 0) | (passes > 0)

    def log_odds(self, region: Region | None = None) -> FloatArray:
        """Log odds of a region's cells; the prior's where there is no evidence."""
        lo, hi = self._region(region)
        hits, passes = self.evidence.region(lo, hi)
        prior = None if self.prior_map is None else self.prior_map.region(lo, hi)
        return self.of_votes(hits, passes, prior)

    @property
    def has_counts(self) -> bool:
        """Evidence has hits and passes."""
        return True

    def part(self, region: Region) -> PlanePart:
        """A region's cells as files take them: see `Belief.part`."""
        lo, hi = self._region(region)
        coords, side = self.evidence.tiles.coords, self.evidence.tiles.side
        if not ((coords >= lo // side) & (coords <= (hi - 1) // side)).all(axis=1).any():
            # Most of a wide map, as a rule: a tenth of the time of zeros worked out.
            shape = tuple(int(n) for n in (hi - lo)[::-1])
            zero = np.broadcast_to(np.float64(0.0), shape)
            return PlanePart(
                np.broadcast_to(self.prior, shape), np.zeros(shape, np.bool_), zero, zero
            )
        hits, passes = self.evidence.region(lo, hi)
        prior = None if self.prior_map is None else self.prior_map.region(lo, hi)
        p = sigmoid(self.of_votes(hits, passes, prior))
        return PlanePart(p, (hits > 0) | (passes > 0), hits, passes)

    def points(self, least: float) -> Iterator[PointPart]:
        """The cells with evidence of a 3D map as points, with their counts: see `Belief.points`."""
        self._check_space()
        values = self._of_cells(sigmoid)
        for index, hits, passes in self.evidence.tiles.parts():
            p = values(hits, passes, partial(np.asarray, index))
            chosen = p >= least
            votes = hits[chosen] / ONE, passes[chosen] / ONE
            yield self._points(index[chosen], p[chosen], *votes)

    def observed(self, region: Region | None = None) -> npt.NDArray[np.bool_]:
        """True where a region's cells have any evidence, also where it cancels out."""
        hits, passes = self.evidence.region(*self._region(region))
        return (hits > 0) | (passes > 0)

    def to_probability_map(self, region: Region | None = None) -> ProbabilityMap:
        """Probabilities with their place in the world: see `Belief.to_probability_map`."""
        if self.ndim != 2 or region is not None or self.prior_map is not None:
            return super().to_probability_map(region)
        # Only cells with evidence are worked out: arrays of all cells' weights take 50 bytes each.
        lo, hi = self._region(None)
        check_room(lo, hi, _PLANE_BYTES)
        shape = tuple(int(n) for n in (hi - lo)[::-1])
        unseen = sigmoid(self.of_votes(np.zeros(1), np.zeros(1)))
        probability, observed = np.full(shape, unseen), np.zeros(shape, np.bool_)
        for index, p in self.parts(sigmoid):
            x, y = (index - lo).T
            probability[y, x], observed[y, x] = p, True
        origin = (float(lo[0]) * self.resolution, float(lo[1]) * self.resolution)
        return ProbabilityMap(probability, observed, self.resolution, origin)

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of cells with evidence, see `EvidenceMap.bounds`."""
        return self.evidence.bounds()

    def save_npz(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write cells, counts and probabilities: see `oddsmap.map_files.npz.save_npz`."""
        from oddsmap.map_files.npz import Column, all_true, save_npz

        tiles, count = self.evidence.tiles, self.evidence.cell_count()
        save_npz(
            Path(path),
            index=Column((count, self.ndim), lambda: (index for index, _, _ in tiles.parts())),
            hits=Column((count,), lambda: (hits / ONE for _, hits, _ in tiles.parts())),
            passes=Column((count,), lambda: (passes / ONE for _, _, passes in tiles.parts())),
            probability=Column((count,), lambda: (p for _, p in self.parts(_single_probability))),
            observed=all_true(count),
            resolution=self.resolution,
            extra=self._extra_columns(),
            force=force,
        )

    def _extra_columns(self) -> dict[str, Column]:
        """What else the view knows of each cell, for `save_npz`."""
        return {}

    def parts(
        self, function: OfLogOdds, *, z: tuple[int, int] | None = None
    ) -> Iterator[tuple[IntArray, npt.NDArray[Any]]]:
        """The cells with evidence, some at a time: see `Belief.parts`; in order of their index."""
        values = self._of_cells(function)
        for index, hits, passes in self.evidence.tiles.parts(last_axis=z):
            yield index, values(hits, passes, partial(np.asarray, index))

    def _state_parts(
        self, thresholds: Thresholds | None, within: Region | None = None
    ) -> Iterator[tuple[IntArray, npt.NDArray[np.int8]]]:
        limits = decided_by(thresholds, self.thresholds)
        states = self._of_cells(lambda x: limits.state(sigmoid(x), np.ones(x.shape, np.bool_)))
        for index, hits, passes in self.evidence.tiles.parts(within=within):
            yield index, states(hits, passes, partial(np.asarray, index))

    def _state_marks(self, marks: Marks, thresholds: Thresholds | None, within: Region) -> Marks:
        if self.prior_map is not None:
            return super()._state_marks(marks, thresholds, within)
        limits = decided_by(thresholds, self.thresholds)

        def of_votes(hits: FloatArray, passes: FloatArray) -> Marks:
            p = sigmoid(self.of_votes(hits, passes))
            return marks[limits.state(p, (hits > 0.0) | (passes > 0.0)).view(np.uint8)]

        return marks_of_box(self.evidence.tiles, within, of_votes(*WHOLE_VOTES), of_votes)

    def _watch(self, within: Region | None) -> Watch | None:
        # A prior map may change without a trace.
        return CountWatch(self, within) if self.prior_map is None else None

    def _settings(self) -> tuple[object, ...]:
        """What decides a state besides the evidence."""
        return type(self), self.prior, self.thresholds, self.clamp, self.prior_map

    def leaves(self, shift: Shift | None = None) -> Leaves:
        """The cells with evidence of a 3D map as leaves of an octree: see `Belief.leaves`."""
        tiles, box = self.evidence.tiles, self.evidence.census().bounds
        cells = np.zeros(self.ndim, np.int64) if shift is None else shift.cells
        base = cells - HALF
        inside = box is None or bool((box[0] >= base).all() and (box[1] <= cells + HALF).all())
        if inside and has_octree_order(tiles, base):
            return TileLeaves(tiles, self.resolution, base, cells, box, self._of_cells)
        return super().leaves(shift)

    def _of_cells(self, function: OfLogOdds) -> OfCells:
        """A function of log odds as one of cells."""
        prior = self.prior_map
        if prior is None:
            table = VoteTable(lambda hits, passes: function(self.of_votes(hits, passes)))
            return lambda hits, passes, _: table(hits, passes)
        return lambda hits, passes, index: function(
            self.of_votes(hits / ONE, passes / ONE, prior.at(index()))
        )

    def known_log_odds(self) -> tuple[IntArray, FloatArray]:
        """The cells with evidence: index, shape (n, d), x first, and log odds, shape (n,)."""
        index, hits, passes = self.evidence.cells()
        prior = None if self.prior_map is None else self.prior_map.at(index)
        return index, self.of_votes(hits / ONE, passes / ONE, prior)

    def _probability_at(self, cells: IntArray) -> FloatArray:
        return self._p_of(cells, *self.evidence.tiles.at(cells))

    def _states_at(self, cells: IntArray, thresholds: Thresholds | None) -> PointStates:
        hits, passes = self.evidence.tiles.at(cells)
        p = self._p_of(cells, hits, passes)
        state = decided_by(thresholds, self.thresholds).state(p, (hits | passes) > 0)
        return PointStates(cells, p, state, hits / ONE, passes / ONE)

    def _p_of(self, cells: IntArray, hits: IntArray, passes: IntArray) -> FloatArray:
        p: FloatArray = self._of_cells(sigmoid)(hits, passes, partial(np.asarray, cells))
        return p

    def _notes(self) -> dict[str, object]:
        return {"prior": self.prior if self.prior_map is None else "map"}


def _single_probability(log_odds: FloatArray) -> npt.NDArray[np.float32]:
    return sigmoid(log_odds).astype(np.float32)


class CountWatch:
    """Where the states of a view may have changed since it was asked last.

    Args:
        view: the view, without a prior map.
        within: the box of cells to watch; None: all.
    """

    def __init__(self, view: CountView, within: Region | None) -> None:
        self._evidence, self._settings = view.evidence, view._settings()
        self._tiles = TileWatch(view.evidence.tiles, within)

    def changed(self, view: object) -> Region | None:
        """The box of cells outside which nothing has changed; None: it is another view."""
        if not isinstance(view, CountView) or view.evidence is not self._evidence:
            return None
        if view._settings() != self._settings:
            return None
        return self._tiles.changed(self._evidence.tiles)
