# SPDX-License-Identifier: Apache-2.0
"""What every view of occupancy answers about distances to obstacles."""

from __future__ import annotations

import numpy as np

from oddsmap.array_types import FloatArray, Region
from oddsmap.odds import Thresholds
from oddsmap.query.boxes import Box
from oddsmap.query.costmap import Costmap, make_costmap
from oddsmap.query.distance_band import DistanceBand
from oddsmap.query.distance_field import DistanceField, box_given
from oddsmap.query.obstacles import ObstacleNames, Obstacles, View, Watch, read_marks
from oddsmap.query.squared_distances import Mask

__all__ = ["DistanceQueries"]


class DistanceQueries:
    """Distances to obstacles, for planners."""

    __slots__ = ()

    def distance_field(
        self: View,
        max_distance: float | None = None,
        *,
        box: Region | None = None,
        region: Region | None = None,
        obstacles: ObstacleNames = "occupied",
        signed: bool = False,
        thresholds: Thresholds | None = None,
        threads: int = 1,
    ) -> DistanceField:
        """How far cells are from the nearest obstacle, exactly, centre to centre.

        All obstacles of the map count, also those outside the box that is asked for.

        Args:
            max_distance: the largest distance asked for [m]; cells without an obstacle that near
                have an infinite one. It saves time, more so in boxes of wide maps, and `update`
                looks only so far. None: any distance.
            box: the cells to answer for, whose centres lie in a box of the map frame: lowest and
                highest corner [m], x first.
            region: the same in cells: (lo, hi), hi past the last. Neither: the box of known cells.
            obstacles: which cells are obstacles: "occupied", "unknown", "undecided" or "free", or
                several of them, as in ("occupied", "unknown"). Cells outside all known ones are
                unknown.
            signed: True: obstacles have distances below 0, minus the distance to the nearest cell
                that is none; False: 0.
            thresholds: what is free and what is occupied; None: the view's.
            threads: how many; the result is the same.

        Returns:
            The distances, as an array and at points.

        Raises:
            InputError: the map has no known cells and no box is given, or the box is none.
            ConfigError: another argument is outside its range.
            MapTooLargeError: the box does not fit in memory.
        """
        return DistanceField(
            self, box_given(self, box, region), max_distance=max_distance,
            obstacles=Obstacles(obstacles, thresholds), signed=signed, threads=threads,
        )  # fmt: skip

    def distance_band(
        self: View,
        max_distance: float,
        *,
        obstacles: ObstacleNames = "occupied",
        signed: bool = False,
        thresholds: Thresholds | None = None,
        threads: int = 1,
    ) -> DistanceBand:
        """Distances of the cells near obstacles alone, exactly: for wide maps, most of all in 3D.

        Memory goes with the obstacles and what lies around them, four bytes per cell, not with the
        box around all of the map.

        Args:
            max_distance: how far from obstacles [m]; beyond, distances are infinite.
            obstacles: as in `distance_field`, without "unknown": such cells are everywhere.
            signed: as in `distance_field`.
            thresholds: what is free and what is occupied; None: the view's.
            threads: how many; the result is the same.

        Raises:
            ConfigError: an argument is outside its range.
            MapTooLargeError: the band does not fit in memory.
        """
        return DistanceBand(
            self, max_distance=max_distance, obstacles=Obstacles(obstacles, thresholds),
            signed=signed, threads=threads,
        )  # fmt: skip

    def costmap(
        self: View,
        inscribed_radius: float,
        *,
        inflation_radius: float = 0.55,
        cost_scaling_factor: float = 10.0,
        inflate_unknown: bool = False,
        inflate_around_unknown: bool = False,
        box: Region | None = None,
        region: Region | None = None,
        thresholds: Thresholds | None = None,
        threads: int = 1,
    ) -> Costmap:
        """Costs of a 2D map as Nav2's costmaps have them: see `oddsmap.inflate`.

        Occupied cells are lethal, free cells cost what inflation gives them, unknown and undecided
        cells are unknown, as they are to Nav2 in a map that `save_ros` writes. Obstacles outside
        the box count, too, as do unknown cells with `inflate_around_unknown`. Defaults are Nav2's.

        Args:
            inscribed_radius: of the largest circle in the robot's footprint about its centre [m].
            inflation_radius: where costs around obstacles end [m].
            cost_scaling_factor: how fast they fall off [1/m].
            inflate_unknown: True: unknown cells near obstacles get a cost, too.
            inflate_around_unknown: True: unknown cells are lethal.
            box: as in `distance_field`, as are region, thresholds and threads.
            region: the box in cells.
            thresholds: what is free and what is occupied; None: the view's.
            threads: how many; the result is the same.

        Raises:
            InputError: a 3D map, one without known cells and no box, or the box is none.
            ConfigError: another argument is outside its range.
            MapTooLargeError: the box does not fit in memory.
        """
        return make_costmap(
            self, box, region, inscribed_radius=inscribed_radius,
            inflation_radius=inflation_radius, cost_scaling_factor=cost_scaling_factor,
            inflate_unknown=inflate_unknown, inflate_around_unknown=inflate_around_unknown,
            thresholds=thresholds, threads=threads,
        )  # fmt: skip

    def _state_marks(
        self: View, marks: Mask, thresholds: Thresholds | None, within: Region
    ) -> Mask:
        """What a table has for the state of each cell of a box: see `read_marks`."""
        lo, hi = within
        box = Box(np.asarray(lo, np.int64), np.asarray(hi, np.int64))
        return read_marks(self, box, marks, thresholds)

    def _map_from_cells(self) -> tuple[FloatArray, FloatArray] | None:
        """Where the map's cells count from, if not from the map frame: rotation, translation."""
        return None

    def _watch(self, within: Region | None) -> Watch | None:
        """What tells where the view's states change, in a box of cells; None: nothing does."""
        return None
