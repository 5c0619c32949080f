# SPDX-License-Identifier: Apache-2.0
"""How well scans fit a map from many poses: what views and maps have of it."""

from __future__ import annotations

from typing import Protocol

from oddsmap.odds import Thresholds
from oddsmap.query.beam_likelihood import BeamLikelihood
from oddsmap.query.likelihood_field import LikelihoodField
from oddsmap.query.obstacles import View
from oddsmap.query.places import CellGrid
from oddsmap.query.ray_caster import RayCaster
from oddsmap.query.scan_at_poses import Frame

__all__ = ["Localising"]


class _View(CellGrid, Protocol):
    """What a view brings along."""

    def _map_from_cells(self) -> Frame | None: ...

    def ray_caster(self, *, thresholds: Thresholds | None = None) -> RayCaster: ...


class Localising:
    """Models of p(scan | map, pose) for Monte-Carlo localisation."""

    __slots__ = ()

    def likelihood_field(
        self: View,
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
            max_distance: a larger distance counts as this [m].
            thresholds: what is free and what is occupied; None: the view's.

        Raises:
            ConfigError: an argument is outside its range.
            MapTooLargeError: memory does not hold the box of occupied cells.
        """
        return LikelihoodField(
            self, thresholds=thresholds, range_max=range_max, sigma_hit=sigma_hit, z_hit=z_hit,
            z_rand=z_rand, max_distance=max_distance,
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
            self.ray_caster(thresholds=thresholds), frame=self._map_from_cells(),
            range_max=range_max, sigma_hit=sigma_hit, lambda_short=lambda_short, z_hit=z_hit,
            z_short=z_short, z_max=z_max, z_rand=z_rand,
        )  # fmt: skip
