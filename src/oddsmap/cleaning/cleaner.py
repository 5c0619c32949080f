# SPDX-License-Identifier: Apache-2.0
"""Points and maps without what moved."""

from __future__ import annotations

import copy
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.cleaning.seen_through import dynamic_cells, share_below_half
from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence_map import EvidenceMap
from oddsmap.kernels.units import ONE
from oddsmap.limits import MAX_COORDINATE
from oddsmap.projection.ground_plane import lowest_of_columns
from oddsmap.projection.ground_surface import GroundSurface, fit_ground_surface
from oddsmap.query.places import check_places, points_in
from oddsmap.scans.given_scans import scans_alone, scans_given
from oddsmap.scans.measurement import Measurement, ranges_of
from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.filters import within_window
from oddsmap.sensors.usable_beams import judge_readings
from oddsmap.short_repr import described, short_repr

__all__ = ["Cleaner", "LabelledScan"]

# The ground of `fit_ground_surface` runs through the centres of its cells, so it is half a cell off
# where the true one runs along their borders; the rest is for its bends within a patch.
_MARGIN = 0.6
# Cells looked at together: columns are sorted again for each part.
_PART = 1 << 22


@dataclass(frozen=True, slots=True, eq=False)
class LabelledScan:
    """The returns of a scan, each static or dynamic.

    Attributes:
        points: returns that mark, in the map frame [m], shape (n, d), in the order of the beams.
        beam: which reading of the scan each is, shape (n,).
        dynamic: True where one is of something that moved, shape (n,).
    """

    points: FloatArray
    beam: IntArray
    dynamic: BoolArray

    __repr__ = short_repr


class Cleaner:
    """Finds what moved: returns in cells that were seen through, before or after.

    A return is dynamic where its cell is (see `oddsmap.cleaning.seen_through`), unless it lies no
    higher than `ground_margin` above the ground. Nothing is learnt from one scan alone: what stood
    still while it was seen, and was gone when nobody looked, stays.

    Args:
        grid: a map of the log, or of another of the same place; votes "scan".

    Other Args:
        level: of the credible interval of a cell's reflectivity, between 0 and 1: lower finds more
            of what moved, and takes more of what stands for it.
        ground_margin: returns up to so far above the ground, and below it, stay [m]; 3D only. None:
            0.6 of a cell. It covers the noise of ranges and poses.

    Raises:
        InputError: the map is not of narrow beams, or empty.
        ConfigError: a value is outside its range.
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield from self.grid.place_facts()
        yield f"level {self.level:g}"
        if self.grid.ndim == 3:
            yield f"ground margin {self.ground_margin:g} m"
        if lost := self.skipped.total():
            yield f"{lost:,} skipped"

    def __init__(
        self, grid: EvidenceMap, *, level: float = 0.5, ground_margin: float | None = None
    ) -> None:
        if not isinstance(grid, EvidenceMap):
            raise InputError(
                f"Cleaner: an EvidenceMap is needed, as it counts hits and passes, got "
                f"{type(grid).__name__}"
            )
        if not isinstance(grid.sensor, BeamSensor):
            raise InputError(
                f"Cleaner: a map of narrow beams is needed, got one of kind {grid.sensor.kind}, "
                "which does not say where a return was"
            )
        if not 0.0 < level < 1.0:
            raise ConfigError(f"level of a credible interval lies between 0 and 1, got {level}")
        if ground_margin is not None and (grid.ndim == 2 or not 0.0 <= ground_margin < np.inf):
            raise ConfigError(
                f"ground_margin is a height of 0 m or more, for 3D maps, got {ground_margin} for a "
                f"{grid.ndim}D map"
            )
        if grid.votes != "scan":
            warnings.warn(
                'a map with votes "beam" counts the beams that graze a cell beside those that meet '
                'it: more of what stands is taken for dynamic than with votes "scan"',
                stacklevel=2,
            )
        self.grid, self.level = grid, float(level)
        # Where the returns are, whatever the votes around them.
        self._sensor = replace(grid.sensor, hit_width=0.0, sigma=0.0, fade=0.0)
        self.ground_margin = _MARGIN * grid.resolution if ground_margin is None else ground_margin
        self.skipped: Counter[str] = Counter()
        """What `label` could not use so far, by reason, as in the report of a map."""
        self._ground = _ground_of(grid, level) if grid.ndim == 3 else None

    def dynamic_at(self, points: npt.ArrayLike) -> BoolArray:
        """Which returns are of something that moved.

        Args:
            points: in the map frame [m], shape (n, d), x first.

        Returns:
            True where one is, shape (n,).

        Raises:
            InputError: another shape, or coordinates that are not finite or farther than 2^46 cells
                from the map's origin.
        """
        places = points_in(points, self.grid.ndim)
        cells = check_places(places / self.grid.resolution)
        distinct, which = _distinct(cells)
        dynamic = dynamic_cells(self.grid, distinct, self.level)[which]
        if self._ground is not None and dynamic.any():
            x, y, z = places[dynamic].T
            dynamic[dynamic] = z - self._ground.at(x, y) > self.ground_margin
        return dynamic

    def label(self, scans: Measurement | Iterable[Measurement]) -> Iterator[LabelledScan]:
        """The returns of scans, labelled, one scan after the other; nothing is kept.

        Readings that the map's sensor model does not count as returns that mark are left out:
        no-returns, those of the robot's own body, those outside of the heights that mark.

        Args:
            scans: a scan, some, or a log.

        Raises:
            InputError: a scan is not of ranges, or of another dimension than the map.
        """
        given: Iterable[Measurement] = scans_given(scans)
        for number, measurement in enumerate(scans_alone(given)):
            (scan,) = ranges_of([measurement])
            if scan.directions.shape[1] != self.grid.ndim:
                raise InputError(
                    f"scan {number} is {scan.directions.shape[1]}D, the map {self.grid.ndim}D"
                )
            points, beam = self._returns(scan)
            yield LabelledScan(points, beam, self.dynamic_at(points))

    def _returns(self, scan: Scan) -> tuple[FloatArray, IntArray]:
        """Where a scan marks, by the rules of mapping, and the numbers of those beams."""
        sensor = self._sensor
        segments, skipped = sensor.segments([scan], MAX_COORDINATE * self.grid.resolution)
        self.skipped += skipped
        if len(segments.hit) == 0:
            return np.empty((0, self.grid.ndim)), np.empty(0, np.int64)
        number = np.arange(scan.size)
        if sensor.angle_window is not None:
            number = np.flatnonzero(within_window(scan, sensor.angle_window))
        used = judge_readings(scan.ranges[number], sensor.limits).used
        vectors = scan.directions if scan.measured_points is None else scan.measured_points
        used &= np.isfinite(vectors[number]).all(axis=1)
        return segments.ends[segments.hit], number[used][segments.hit]

    def static_map(self) -> EvidenceMap:
        """The map without what moved.

        The hits of dynamic cells are taken out, and their passes stay: what was seen through is
        free. All other cells stay as they are, and so do those on the ground. The last entry of the
        provenance says how many cells and how many hits were taken out.

        Returns:
            A new map of the same configuration.
        """
        clean = copy.deepcopy(self.grid)
        clean.report = None
        out = self.grid.like()
        taken, count = 0, 0
        for index, hits, _ in self.grid.tiles.parts():
            met = hits > 0
            cells, weights = index[met], hits[met]
            gone = dynamic_cells(self.grid, cells, self.level)
            if self._ground is not None and gone.any():
                x, y, z = self.grid.centre_of(cells[gone]).T
                lowest = z - self.grid.resolution / 2
                gone[gone] = lowest - self._ground.at(x, y) > self.ground_margin
            out.add_cells(cells[gone], weights[gone], np.zeros(int(gone.sum()), np.int64))
            taken, count = taken + int(weights[gone].sum()), count + int(gone.sum())
        clean.subtract(out)
        clean.provenance = copy.deepcopy(self.grid.provenance)
        clean.record(
            None, cleaned_cells=count, cleaned_hits=taken / ONE, level=self.level,
            **({} if self._ground is None else {"ground_margin": self.ground_margin}),
        )  # fmt: skip
        return clean


def _ground_of(grid: EvidenceMap, level: float) -> GroundSurface:
    """The ground under what is not seen through."""
    standing: list[IntArray] = []
    lowest_free = np.empty((0, 3), np.int64)
    for index, hits, passes in grid.tiles.parts(_PART):
        met = hits > 0
        sure = share_below_half(hits[met], passes[met])
        standing.append(index[met][sure <= (1.0 + level) / 2.0])
        # Of the free cells the lowest of each column is all that is asked for.
        lowest_free = lowest_of_columns(np.concatenate([lowest_free, index[~met]]))
    occupied = np.concatenate([np.empty((0, 3), np.int64), *standing])
    if len(occupied) == 0:
        raise InputError("Cleaner: nothing stands in this map: there is nothing to clean")
    return fit_ground_surface(occupied, grid.resolution, lowest_free)


def _distinct(cells: IntArray) -> tuple[IntArray, IntArray]:
    """The distinct cells, and which of them each is."""
    order = np.lexsort(cells.T)
    ordered = cells[order]
    first = np.ones(len(cells), np.bool_)
    first[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    which = np.empty(len(cells), np.int64)
    which[order] = np.cumsum(first) - 1
    return ordered[first], which
