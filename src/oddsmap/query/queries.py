# SPDX-License-Identifier: Apache-2.0
"""What every view of occupancy answers: points in metres to probabilities and states, and rays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.odds import Thresholds
from oddsmap.query.beam_likelihood import BeamLikelihood
from oddsmap.query.likelihood_field import LikelihoodField
from oddsmap.query.places import CellGrid, Placed
from oddsmap.query.ray_caster import RayCaster, RayHits, Until
from oddsmap.query.scan_at_poses import Frame

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


class _View(CellGrid, Protocol):
    """What a view brings along to be asked."""

    def cell_of(self, points: npt.ArrayLike) -> IntArray: ...

    def _probability_at(self, cells: IntArray) -> FloatArray: ...

    def _states_at(self, cells: IntArray, thresholds: Thresholds | None) -> PointStates: ...

    def _state_parts(
        self, thresholds: Thresholds | None
    ) -> Iterator[tuple[IntArray, npt.NDArray[np.int8]]]: ...

    def _map_from_grid(self) -> Frame | None: ...

    def ray_caster(self, *, thresholds: Thresholds | None = None) -> RayCaster: ...


class Queries(Placed):
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
        return RayCaster(self, self._state_parts(thresholds), frame=self._map_from_grid())

    def likelihood_field(
        self: _View,
        range_max: float,
        *,
        sigma_hit: float = 0.2,
        z_hit: float = 0.95,
        z_rand: float = 0.05,
        max_distance: float = 2.0,
        thresholds: Thresholds | None = None,
    ) -> LikelihoodField:
        """How well scans fit this map by the distance of their ends to occupied cells.

        For Monte-Carlo localisation: `log_likelihood(poses, scan)` of what it returns takes
        thousands of poses at once. The formula and its source: see `LikelihoodField`. Defaults are
        AMCL's.

        Args:
            range_max: readings from here on are no-returns, which are left out [m].
            sigma_hit: standard deviation of the distance [m].
            z_hit: weight of ends at obstacles.
            z_rand: weight of random readings.
            max_distance: a larger distance counts as this [m], at most 255 cells.
            thresholds: what is free and what is occupied; None: the view's.

        Raises:
            ConfigError: an argument is outside its range.
            MapTooLargeError: memory does not hold the box of occupied cells.
        """
        return LikelihoodField(
            self, self._state_parts(thresholds), frame=self._map_from_grid(), range_max=range_max,
            sigma_hit=sigma_hit, z_hit=z_hit, z_rand=z_rand, max_distance=max_distance,
        )  # fmt: skip

    def beam_likelihood(
        self: _View,
        range_max: float,
        *,
        sigma_hit: float = 0.2,
        lambda_short: float = 0.1,
        z_hit: float = 0.8,
        z_short: float = 0.1,
        z_max: float = 0.05,
        z_rand: float = 0.05,
        thresholds: Thresholds | None = None,
    ) -> BeamLikelihood:
        """How well scans fit this map by what their rays meet first: the beam model.

        As `likelihood_field`, at the price of a ray for each beam and pose; no-returns and people
        in the way count, too. The formula and its source: see `BeamLikelihood`.

        Args:
            range_max: readings from here on are no-returns [m].
            sigma_hit: standard deviation of a reading [m].
            lambda_short: rate of what is in the way and not in the map [1 / m].
            z_hit: weight of readings at obstacles; the four add up to 1.
            z_short: weight of shorter ones.
            z_max: weight of no-returns.
            z_rand: weight of random readings.
            thresholds: what is free and what is occupied; None: the view's.

        Raises:
            ConfigError: an argument is outside its range.
        """
        return BeamLikelihood(
            self.ray_caster(thresholds=thresholds), frame=self._map_from_grid(),
            range_max=range_max, sigma_hit=sigma_hit, lambda_short=lambda_short, z_hit=z_hit,
            z_short=z_short, z_max=z_max, z_rand=z_rand,
        )  # fmt: skip

    def _map_from_grid(self) -> Frame | None:
        """Where cells count from; None: the map frame."""
        return None
