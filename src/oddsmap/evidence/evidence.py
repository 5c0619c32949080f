# SPDX-License-Identifier: Apache-2.0
"""Evidence: for each cell, how many hits and how many passes.

Both are exact integers, in units of 1/65536 vote. They add up in any order, so maps of one frame
merge by addition. This is data alone: `oddsmap.EvidenceMap` adds the views and the files.
"""

from __future__ import annotations

import copy
import math
import warnings
from typing import Self

import numpy as np
import numpy.typing as npt

from oddsmap.cell_index import cell_box
from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.arithmetic import (
    add_scaled,
    check_same_kind,
    coarser,
    crop_tiles,
    difference,
    factor_of,
    merge_tiles,
)
from oddsmap.evidence.counted_cells import CountedCells
from oddsmap.evidence.frames import (
    axes_of,
    axes_of_up,
    named_numbers,
    rotation_and_position,
    turned,
    whole_cells,
)
from oddsmap.evidence.nearest import resampled
from oddsmap.poses.given_pose import PoseLike, pose_of

__all__ = ["Evidence"]


class Evidence(CountedCells):
    """Hits and passes of a field of cells, which add up, come apart, and go to other frames.

    It is made, filled and read as `oddsmap.evidence.counted_cells.CountedCells` says, whose
    arguments it takes. Cell i covers [i * resolution, (i + 1) * resolution) in the map frame,
    along each axis.
    """

    def merge(self, other: Evidence, *, any_sensor: bool = False) -> None:
        """Add another map of the same frame to this one, exactly.

        Args:
            other: the map to add.
            any_sensor: True: also one of another kind of sensor. The sum does not know any more
                which votes were whose, and views weigh all by this map's sensor model.

        Raises:
            InputError: the maps differ in resolution, dimensions, kind of votes, half-life or what
                it counts back from (see `rescaled`), in whether they keep lengths, or in the kind
                of sensor.
        """
        self.check_same_kind_as(other, any_sensor=any_sensor, done="added")
        merge_tiles(self.tiles, other.tiles)
        if self.lengths is not None and other.lengths is not None:
            merge_tiles(self.lengths, other.lengths)
        self.provenance.extend(copy.deepcopy(other.provenance))

    def subtract(self, other: Evidence, *, any_sensor: bool = False) -> None:
        """Take the evidence of another map out of this one again, exactly: `merge` undone.

        Of the provenance, too, the other's entries are taken out where they are all there;
        otherwise an entry notes what was subtracted.

        Args:
            other: what is to be taken out.
            any_sensor: as in `merge`.

        Raises:
            InputError: as in `merge`, or a cell has less than is to be taken out; then nothing
                has changed.
        """
        self.check_same_kind_as(other, any_sensor=any_sensor, done="subtracted")
        left, lengths = difference(self.tiles, other.tiles, self.resolution), self.lengths
        if self.lengths is not None and other.lengths is not None:
            lengths = difference(self.lengths, other.lengths, self.resolution)
        self.tiles, self.lengths = left, lengths
        theirs, own = copy.deepcopy(other.provenance), copy.deepcopy(self.provenance)
        try:
            for entry in theirs:
                own.remove(entry)
        except ValueError:
            self.record(None, subtracted=theirs)
        else:
            self.provenance = own

    def check_same_kind_as(self, other: Evidence, *, any_sensor: bool, done: str) -> None:
        """Refuse what does not add up with this map: see `merge`; `done` is "added" or the like."""
        if not isinstance(other, Evidence):
            raise InputError(
                f"only evidence is {done}, and a {type(other).__name__} holds no hits and passes"
            )
        if self.ndim != other.ndim:
            raise InputError(
                f"maps of different ndim cannot be {done}: one is {self.ndim}D, the other "
                f"{other.ndim}D"
            )
        check_same_kind(self.config, other.config, any_sensor=any_sensor, done=done)

    def __add__(self, other: object) -> Self:
        """A new map with the evidence of both: see `merge`."""
        if not isinstance(other, Evidence):
            return NotImplemented
        total = self._copy()
        total.merge(other)
        return total

    def __radd__(self, other: object) -> Self:
        """What `sum` of several maps begins with: 0 and the first."""
        return self._copy() if isinstance(other, int) and other == 0 else NotImplemented

    def __sub__(self, other: object) -> Self:
        """A new map without the evidence of the other: see `subtract`."""
        if not isinstance(other, Evidence):
            return NotImplemented
        rest = self._copy()
        rest.subtract(other)
        return rest

    def resample(self, resolution: float) -> Self:
        """A new map of larger cells, each with the sum of the evidence of those that lie in it.

        It is exact, and not what mapping at that resolution makes: there a scan or a beam votes
        once for a large cell, here once for each small cell in it that it met. So a cell has more
        votes, hits from a wall and passes from the space before it among them, and its posterior
        is more extreme.

        Args:
            resolution: side of a cell [m], a whole multiple of this map's.

        Raises:
            ConfigError: it is none; the nearest are named.
            InputError: the map keeps lengths, which have no exact sum.
            MapTooLargeError: a cell would pass 2^46 votes.
        """
        factor = factor_of(self.resolution, resolution)
        if factor == 1:
            return self._copy()
        if self.lengths is not None:
            raise InputError(
                "the map keeps path lengths, in 65536ths of a cell's side: those of a larger cell "
                "are no whole numbers of them; build the map again at the coarser resolution"
            )
        large = self.like(resolution=float(resolution))
        coarser(large.tiles, self.tiles, factor)
        large.provenance = copy.deepcopy(self.provenance)
        large.record(None, resampled_from=self.resolution)
        return large

    def rotated(self, axes: str | None = None, *, up: str | None = None) -> Self:
        """A new map in a frame turned by quarter turns about the origin, exactly.

        Cells go to whole cells, with their hits, passes and lengths. Heights that the sensor model
        has for marks (mark_z_min, mark_z_max) stay the numbers that they were.

        Args:
            axes: the old axis that each new one is, in order: "z -x -y" makes x of z, y of -x and
                z of -y, which takes an optical frame (x right, y down, z forward) to x forward,
                y left, z up. In 2D such as "y -x".
            up: 3D, in place of `axes`: the old axis that is to point up, such as "-y". x stays, or
                y where x points up.

        Raises:
            ConfigError: not one of the two, axes that are not each axis once or a mirror image, or
                `up` of a 2D map.
        """
        if (axes is None) == (up is None):
            raise ConfigError("a map is turned by axes or by up: give one of the two")
        if up is not None and self.ndim != 3:
            raise ConfigError('up turns maps of space, this one is 2D: give axes, such as "y -x"')
        stated = axes_of_up(up) if up is not None else " ".join(str(axes).replace(",", " ").split())
        way = axes_of(stated, self.ndim)
        other = self.like()
        turned(other.tiles, self.tiles, way)
        if other.lengths is not None and self.lengths is not None:
            turned(other.lengths, self.lengths, way)
        other.provenance = copy.deepcopy(self.provenance)
        other.record(None, rotated=stated)
        return other

    def transformed(self, pose: PoseLike) -> Self:
        """A new map in another frame: `a + b.transformed(a_from_b)` adds up maps of two frames.

        Quarter turns with shifts by whole cells are exact: cells go to whole cells, with their
        hits, passes and lengths. They are those that take the centre of each cell with evidence to
        that of another, up to a hundredth of a cell. Otherwise the map is resampled, and a warning
        says at what cost: each cell has the hits and passes of the cell that holds its centre,
        turned back, so that the counts of some are repeated and those of others dropped, and a wall
        is off by up to half a cell's diagonal. Either way sums stay sums.

        The provenance says where from each log was moved. Heights that the sensor model has for
        marks stay the numbers that they were.

        Args:
            pose: of this map's frame in the new one, new_from_old [m, rad], in any form that a
                scan's pose has, such as (x, y, yaw). Of a map of space, a pose in the plane turns
                about z.

        Raises:
            InputError: no finite pose, one of space for a 2D map, the map keeps path lengths and
                the transform is not exact, or the map would lie out of reach.
        """
        known = pose_of(pose)
        rotation, position = rotation_and_position(known, self.ndim)
        shift = position / self.resolution
        if not shift.any() and np.array_equal(rotation, np.eye(self.ndim)):
            return self._copy()
        nowhere = np.zeros(self.ndim, np.int64)
        way = whole_cells(rotation, shift, *(self.bounds() or (nowhere, nowhere + 1)))
        if way is None and self.lengths is not None:
            raise InputError(
                "the map keeps path lengths, which only quarter turns with shifts by whole cells "
                f"({self.resolution:g} m) can move: build it from its log with poses of the other "
                "frame"
            )
        moved = self.like()
        numbers, facts = named_numbers(known), {}
        if way is None:
            cost = resampled(moved.tiles, self.tiles, rotation, shift)
            facts = {"resampling": cost._asdict()}
            warnings.warn(
                f"moved by no quarter turn and whole cells, so resampled: {cost}; built from its "
                "log with poses of the other frame it would be exact",
                stacklevel=2,
            )
        else:
            turned(moved.tiles, self.tiles, way)
            if moved.lengths is not None and self.lengths is not None:
                turned(moved.lengths, self.lengths, way)
        # In each entry, too: so that evidence of a log is told from the same moved.
        moved.provenance = [
            {**entry, "moved": [*entry.get("moved", ()), numbers]}
            for entry in copy.deepcopy(self.provenance)
        ]
        moved.record(None, transformed=numbers, exact=way is not None, **facts)
        return moved

    def crop(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> Self:
        """A new map with only the cells of a box; arguments and errors as in `region`."""
        first, last = cell_box(lo, hi, self.ndim)
        part = self.like()
        crop_tiles(part.tiles, self.tiles, first, last)
        if part.lengths is not None and self.lengths is not None:
            crop_tiles(part.lengths, self.lengths, first, last)
        part.provenance = copy.deepcopy(self.provenance)
        return part

    def crop_box(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> Self:
        """A new map with only the cells whose centres lie in a box of metres.

        Args:
            lo: lowest corner [m], shape (d,), x first; a centre on it is inside.
            hi: highest corner [m], shape (d,); a centre on it is outside.

        Raises:
            InputError: they are not d numbers each, or hi is not above lo.
        """
        return self.crop(*self.region_of(lo, hi))

    def rescaled(self, t_ref_ns: int) -> Self:
        """A new map whose half-life counts back from a later time, to go on with later scans.

        Every weight is multiplied by one factor and rounded, so the result differs from that of a
        map made for this t_ref_ns by roundings: it is inexact. The provenance says so, and how
        many weights above 0 became 0.

        Args:
            t_ref_ns: the later time [ns].

        Raises:
            ConfigError: the map has no half-life, or the time is earlier than its own.
        """
        half_life, before = self.config.map.half_life, self.config.map.t_ref_ns
        if half_life is None or before is None:
            raise ConfigError("only evidence with a half-life can be rescaled: this map has none")
        if t_ref_ns < before:
            raise ConfigError(
                f"t_ref_ns {t_ref_ns} is earlier than the map's {before}: what was forgotten "
                "cannot come back"
            )
        factor = math.exp2(-(t_ref_ns - before) / (1e9 * half_life))
        later = self.like(t_ref_ns=t_ref_ns)
        underflowed = add_scaled(later.tiles, self.tiles, factor)
        facts = {
            "rescaled_from_t_ref_ns": before,
            "t_ref_ns": t_ref_ns,
            "vote.underflow": underflowed,
        }
        if later.lengths is not None and self.lengths is not None:
            facts["length.underflow"] = add_scaled(later.lengths, self.lengths, factor)
        later.provenance = copy.deepcopy(self.provenance)
        later.record(None, **facts)
        return later
