# SPDX-License-Identifier: Apache-2.0
"""What every view of occupancy answers: points in metres to probabilities and states, and rays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.odds import Thresholds
from oddsmap.query.distance_queries import DistanceQueries
from oddsmap.query.exploring import ExploreQueries
from oddsmap.query.localising import Localising
from oddsmap.query.places import CellGrid, Placed
from oddsmap.query.predicting import Predicting
from oddsmap.query.ray_caster import RayCaster, RayHits, Until
from oddsmap.query.scan_at_poses import Frame
from oddsmap.short_repr import short_repr

__all__ = ["PointStates", "Queries"]


@dataclass(frozen=True, slots=True, eq=False)
class PointStates:
    """What is known at points, shape (n,) each unless said otherwise.

    Attributes:
        cell: the cells that hold the points, shape (n, d), x first.
        probability: as `at` gives it.
        state: values of `oddsmap.State`; `State.UNKNOWN` where nothing was seen, whatever the
            prior.
        hits: weight of hits [votes]; None: the view has no counts.
        passes: weight of passes [votes]; likewise.
        interval: lower and upper ends of the credible interval of the reflectivity; None: the view
            has none.
    """

    cell: IntArray
    probability: FloatArray
    state: npt.NDArray[np.int8]
    hits: FloatArray | None = None
    passes: FloatArray | None = None
    interval: tuple[FloatArray, FloatArray] | None = None

    __repr__ = short_repr


class _View(CellGrid, Protocol):
    """What a view brings along to be asked."""

    def cell_of(self, points: npt.ArrayLike) -> IntArray: ...

    def _probability_at(self, cells: IntArray) -> FloatArray: ...

    def _states_at(self, cells: IntArray, thresholds: Thresholds | None) -> PointStates: ...

    def _state_parts(
        self, thresholds: Thresholds | None, within: Region | None = None
    ) -> Iterator[tuple[IntArray, npt.NDArray[np.int8]]]: ...

    def _map_from_cells(self) -> Frame | None: ...

    def ray_caster(self, *, thresholds: Thresholds | None = None) -> RayCaster: ...


class Queries(DistanceQueries, ExploreQueries, Localising, Predicting, Placed):
    """Questions in metres. Points: finite, within 2^46 cells of the map's origin, or refused."""

    __slots__ = ()

    def at(self: _View, points: npt.ArrayLike) -> FloatArray:
        """p(occupied) at points; the prior where nothing was seen.

        Of views of reflectivity it is the mean reflectivity. A map without a prior has NaN outside
        its leaves (`VoxelMap`) or its rectangle (`ProbabilityMap`).

        Args:
            points: in the map frame [m], shape (n, d), x first.

        Returns:
            The probability of the cell that holds each point, shape (n,).

        Raises:
            InputError: another shape, or coordinates that are not finite or farther than 2^46 cells
                from the map's origin.
        """
        return self._probability_at(self.cell_of(points))

    def states_at(
        self: _View, points: npt.ArrayLike, *, thresholds: Thresholds | None = None
    ) -> PointStates:
        """All that is known at points: state, hits and passes, interval.

        Args:
            points: in the map frame [m], shape (n, d), x first.
            thresholds: what is free and what is occupied; None: the view's.

        Raises:
            InputError: as in `at`.
            ConfigError: thresholds for a view of reflectivity, which decides by its interval.
        """
        return self._states_at(self.cell_of(points), thresholds)

    def cast_rays(
        self: _View,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        max_range: float,
        *,
        until: Until = "occupied",
        thresholds: Thresholds | None = None,
        threads: int = 1,
    ) -> RayHits:
        """The first occupied (or unknown) cell along each ray.

        The states of all cells are decided first, which takes a moment on large maps: whoever casts
        a few rays many times keeps a `ray_caster`. Cells along a ray are exact, by the rules of
        mapping: those in which it has a length; touched corners and edges are none. The cell that
        it starts in counts, at distance 0.

        Args:
            origins: starts of the rays in the map frame [m], shape (n, d), x first; or (d,), one
                for all.
            directions: of length 1, shape (n, d).
            max_range: where rays end [m], above 0; infinity: beyond all known cells.
            until: what ends a ray: "occupied", "unknown", "free" or "undecided", or several of
                them, as in ("occupied", "unknown"). Unknown cells let rays pass unless named.
            thresholds: what is free and what is occupied; None: the view's.
            threads: how many; the result is the same.

        Returns:
            Distance to the cell's entry, the cell, and what ended the ray: see `RayHits`.

        Raises:
            InputError: points as in `at`, or directions that are not of length 1.
            ConfigError: another argument is outside its range.
        """
        caster = self.ray_caster(thresholds=thresholds)
        return caster.cast(origins, directions, max_range, until=until, threads=threads)

    def ray_caster(self: _View, *, thresholds: Thresholds | None = None) -> RayCaster:
        """The states of all cells as they are now, to cast rays many times: see `cast_rays`.

        Args:
            thresholds: what is free and what is occupied; None: the view's.
        """
        return RayCaster(self, self._state_parts(thresholds), frame=self._map_from_cells())

    def _map_from_cells(self) -> Frame | None:
        """Where cells count from; None: the map frame."""
        return None
