# SPDX-License-Identifier: Apache-2.0
"""What every view answers to whoever explores: where it ends, and what a look would tell."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError
from oddsmap.odds import Thresholds
from oddsmap.query.frontiers import Box, Connectivity, Frontier, find_frontiers
from oddsmap.query.gain import Measure, PosesLike, Votes, expected_gains
from oddsmap.query.places import CellGrid

__all__ = ["ExploreQueries"]

# A cell that no map has seen.
_NOWHERE = 1 << 46


class _View(CellGrid, Protocol):
    """What a view brings along to be asked."""

    def centre_of(self, cells: npt.ArrayLike) -> FloatArray: ...

    def _probability_at(self, cells: IntArray) -> FloatArray: ...

    def _state_parts(
        self, thresholds: Thresholds | None
    ) -> Iterator[tuple[IntArray, npt.NDArray[np.int8]]]: ...

    def _probability_parts(self) -> Iterator[tuple[IntArray, FloatArray]]: ...

    def _map_from_cells(self) -> tuple[FloatArray, FloatArray] | None: ...


class ExploreQueries:
    """Questions in metres."""

    __slots__ = ()

    def frontiers(
        self: _View,
        *,
        next_to: Connectivity = "sides",
        joined: Connectivity = "corners",
        min_size: float = 0.0,
        min_cells: int = 1,
        box: Box | None = None,
        thresholds: Thresholds | None = None,
    ) -> list[Frontier]:
        """Free cells beside unknown ones, in clusters, the largest first: where to look next.

        Unknown are all cells that nothing was seen of, those outside the map among them; cells that
        are undecided are neither.

        Args:
            next_to: which unknown neighbours count: "sides" (4 in 2D, 6 in 3D) or also those at
                "corners" (8, 26).
            joined: which neighbours are of one cluster, likewise.
            min_size: smaller ones are left out: a length [m], in 3D an area [m^2]; see `Frontier`.
            min_cells: the same as a number of cells.
            box: lowest and highest corner [m], shape (d,) each: only cells with their centres in it
                count. None: all.
            thresholds: what is free and what is occupied; None: the view's.

        Raises:
            InputError: the box is none.
            ConfigError: another argument is outside its range.

        Source: B. Yamauchi, A frontier-based approach for autonomous exploration, 1997.
        """
        return find_frontiers(
            self, self._state_parts(thresholds), next_to=next_to, joined=joined,
            min_size=min_size, min_cells=min_cells, box=box,
        )  # fmt: skip

    def information_gain(
        self: _View,
        poses: PosesLike,
        directions: npt.ArrayLike,
        max_range: float,
        *,
        p_hit: float | None = None,
        p_miss: float | None = None,
        unknown: float | None = None,
        clear_range: float | None = None,
        votes: Votes | None = None,
        measure: Measure = "information",
        threads: int = 1,
    ) -> FloatArray:
        """What a scan from each of some poses is expected to tell [nats].

        Beams are narrow and end in the first occupied cell, without noise; cells are independent of
        each other along a beam. What a reading tells is what the inverse sensor model makes of it:
        p_hit for the cell that the beam ends in, p_miss for those before. It is worked out in one
        step per cell.

        Args:
            poses: of the sensor, n of them: see `oddsmap.query.gain.PosesLike`.
            directions: of its beams in the sensor frame, unit vectors, shape (m, d).
            max_range: how far it sees [m]: a cell that is entered before may return a beam.
            p_hit: p(x | z) of a hit at prior 1/2; None: that of a view that has one.
            p_miss: p(x | z) of a pass at prior 1/2; likewise.
            unknown: p(occupied) of cells that nothing was seen of; None: what `at` says of them,
                and 1/2 where that is nothing. With 1/2 half of the beams end in the first of them:
                a lower number lets a scan look further into what is unknown.
            clear_range: how far a beam clears that meets nothing before max_range [m]; None: up to
                there, as a reading of +Inf does. 0: it tells nothing.
            votes: "beam": what all beams tell is added up; what two of them tell of one cell counts
                twice, near the sensor many times: more than the scan tells. "scan": each
                cell counts once, by the beam that most probably gets there: less than the scan
                tells, as another beam may get there in its place. None: as the map votes, and
                "beam" where a view does not know.
            measure: "information": the expected divergence of what is believed of each cell
                afterwards from before (Shannon's mutual information, if the inverse model is
                that of Bayes), never below 0. "entropy": how much the sum of all cells' entropies
                is expected to fall, which may be below 0: a hit in a cell taken for free.
            threads: how many; the result is the same.

        Returns:
            One number for each pose, shape (n,).

        Raises:
            InputError: poses or directions are none of these.
            ConfigError: another argument is outside its range, or p_hit and p_miss are missing.
            MapTooLargeError: with votes "scan", the cells of one scan would not fit in memory.

        Source: Z. Zhang, T. Henderson, S. Karaman, V. Sze: FSMI: Fast computation of Shannon mutual
            information for information-theoretic mapping, IJRR 2020, for a sensor without noise.
        """
        hit = getattr(self, "p_hit", None) if p_hit is None else p_hit
        miss = getattr(self, "p_miss", None) if p_miss is None else p_miss
        if hit is None or miss is None:
            raise ConfigError(
                "this map knows no sensor model: give p_hit and p_miss (of a BeamSensor: 0.7, 0.4)"
            )
        if unknown is None:
            if getattr(self, "prior_map", None) is not None:
                raise ConfigError(
                    "the view's prior is a map, which says something of every cell: give unknown"
                )
            unknown = float(self._probability_at(np.full((1, self.ndim), _NOWHERE))[0])
            unknown = 0.5 if math.isnan(unknown) else unknown
        if votes is None:
            own = getattr(getattr(self, "evidence", None), "votes", "beam")
            votes = "scan" if own == "scan" else "beam"
        return expected_gains(
            self, self._probability_parts(), poses, directions, max_range, p_hit=hit,
            p_miss=miss, unknown=unknown, clear_range=clear_range, votes=votes,
            measure=measure, threads=threads, frame=self._map_from_cells(),
        )  # fmt: skip
