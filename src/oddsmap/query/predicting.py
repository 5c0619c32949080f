# SPDX-License-Identifier: Apache-2.0
"""What readings a map predicts along rays: what views and maps have of it."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError
from oddsmap.odds import State, Thresholds
from oddsmap.query.places import CellGrid
from oddsmap.query.predicted_ranges import MapAlongRays, RangeDistribution, model_of
from oddsmap.query.ray_caster import rays_in
from oddsmap.query.scan_at_poses import Frame

__all__ = ["Predicting"]


class _States(Protocol):
    """Of `PointStates`, what is asked here."""

    @property
    def probability(self) -> FloatArray: ...
    @property
    def state(self) -> npt.NDArray[np.int8]: ...


class _View(CellGrid, Protocol):
    """What a view brings along."""

    _reflects: ClassVar[bool]

    def _map_from_cells(self) -> Frame | None: ...

    def _probability_at(self, cells: IntArray) -> FloatArray: ...

    def _states_at(self, cells: IntArray, thresholds: Thresholds | None) -> _States: ...

    def _along(
        self, origins: npt.ArrayLike, directions: npt.ArrayLike, unknown: float | None
    ) -> MapAlongRays: ...


class Predicting:
    """The forward model along rays."""

    __slots__ = ()

    _reflects: ClassVar[bool] = False
    """Whether `at` gives the chance that a cell returns a beam, not that it is occupied."""

    def expected_ranges(
        self: _View,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        sensor: object,
        *,
        unknown: float | None = None,
    ) -> FloatArray:
        """How far the first echo is expected along each ray, given all probabilities.

        The mean distance of what returns the beam first, range_max where nothing does: what the map
        says, without the sensor's random readings, dropouts and noise, which are in
        `range_distribution`. Cells are taken as independent. The cell that a ray starts in is free:
        the sensor stands there. Where free cells and walls are certain this is what `cast_rays`
        gives. Cells that were passed once or twice (p = 0.4 and 0.31 by default) stop many beams:
        ask maps of many scans, or full maps.

        Args:
            origins: starts of the rays in the map frame [m], shape (n, d), x first; or (d,), one
                for all.
            directions: of length 1, shape (n, d).
            sensor: with its range_max: a `BeamSensor` (rays), a `ConeSensor` (cones about them) or
                a `ForwardModel`.
            unknown: probability of cells that nothing is known of; None: as `at` gives it, the
                prior's.

        Returns:
            Distances [m], shape (n,).

        Raises:
            InputError: rays as in `cast_rays`.
            ConfigError: the sensor has no forward model or no range_max, or the map has no prior
                and `unknown` is not given.

        Source: Thrun, Learning occupancy grid maps with forward sensor models (2003).
        """
        return model_of(sensor).expected_ranges(self._along(origins, directions, unknown))

    def range_distribution(
        self: _View,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        sensor: object,
        *,
        bin_width: float | None = None,
        unknown: float | None = None,
    ) -> RangeDistribution:
        """p(z) along each ray, all of it: the forward model under the map's probabilities.

        Args:
            origins: as in `expected_ranges`, and so are directions, sensor and unknown.
            directions: see there.
            sensor: see there.
            bin_width: of readings [m]; None: the model's own, a quarter of a cell.
            unknown: see there.

        Returns:
            Probabilities of readings in bins, of no return and of no information, 1 in all.

        Raises:
            InputError: as `expected_ranges`.
            ConfigError: likewise, or bin_width is outside its range.
            MapTooLargeError: memory does not hold bins of all rays.
        """
        along = self._along(origins, directions, unknown)
        return model_of(sensor).range_distribution(along, bin_width)

    def _along(
        self: _View, origins: npt.ArrayLike, directions: npt.ArrayLike, unknown: float | None
    ) -> MapAlongRays:
        if unknown is not None and not 0.0 <= unknown <= 1.0:
            raise ConfigError(f"unknown is a probability from 0 to 1, got {unknown}")
        start, way = rays_in(self, self._map_from_cells(), origins, directions)

        def occupancy(cells: IntArray) -> FloatArray:
            if unknown is not None:
                found = self._states_at(cells, None)
                return np.where(found.state == State.UNKNOWN, unknown, found.probability)
            p = self._probability_at(cells)
            if np.isnan(p).any():
                raise ConfigError(
                    "this map has no prior: say how probably cells that it knows nothing of are "
                    "occupied, as in unknown=0.5"
                )
            return p

        return MapAlongRays(self.resolution, start, way, occupancy, self._reflects)
