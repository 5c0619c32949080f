# SPDX-License-Identifier: Apache-2.0
"""How far each cell of a box is from the nearest obstacle, exactly."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray, Region
from oddsmap.cell_index import box_cells, cell_box, cell_indices, check_room
from oddsmap.errors import ConfigError, InputError
from oddsmap.kernels.query.distances import FAR
from oddsmap.limits import in_metres
from oddsmap.plot.thumbnail import Pictured, Thumbnail, of_quantity
from oddsmap.query.boxes import Box
from oddsmap.query.given_numbers import check_numbers, check_threads
from oddsmap.query.obstacles import Obstacles, View, Watch
from oddsmap.query.places import Framed
from oddsmap.query.renewal import boxes_to_renew
from oddsmap.query.squared_distances import Mask, Squared, none_of, squared_to
from oddsmap.short_repr import described, grid_facts, in_bytes

if TYPE_CHECKING:
    from typing import Unpack

    from matplotlib.axes import Axes

    from oddsmap.plot.on_axes import PlotOptions

__all__ = ["DistanceField", "box_given"]

# Mask and distances, twice while signs are worked out, in 8 bytes at worst.
_BYTES = 20
# Without a largest distance a small box of a wide map is first looked at with so many cells around
# it, then with four times as many, until the obstacles found are nearer than what was left out.
_FIRST_HALO = 64


class DistanceField(Framed, Pictured):
    """Distances between the centres of cells and of their nearest obstacles.

    A cell that is an obstacle has distance 0; in a signed field it has the distance to the nearest
    cell that is none, below 0. Every obstacle of the map counts, also those outside the box. Where
    none is within `max_distance` the distance is infinite.

    Args:
        view: the map.
        box: the cells to be answered for; None: the box of known cells, which `update` follows.
        max_distance: the largest distance asked for [m]; None: any.
        obstacles: which cells are obstacles.
        signed: whether obstacles get distances below 0.
        threads: how many; the result is the same.

    Attributes:
        ndim: 2 or 3.
        resolution: side of a cell [m].
        max_distance: the largest distance that was asked for [m]; None: any.
        signed: whether obstacles have distances below 0.
        map_from_cells: where cells count from, if not from the map frame: rotation, translation.

    Raises:
        InputError: the map has no cells and no box is given, or the box is too far from it.
        ConfigError: a parameter is outside its range.
        MapTooLargeError: the box does not fit in memory.

    Source:
        Felzenszwalb, Huttenlocher: Distance transforms of sampled functions (2012).
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield from grid_facts(self.ndim, self.resolution, None, (self._box.lo, self._box.hi))
        yield "signed" if self.signed else "unsigned"
        if self.max_distance is not None:
            yield f"up to {self.max_distance:g} m"
        yield in_bytes(self.nbytes)

    def __init__(
        self,
        view: View,
        box: Box | None,
        *,
        max_distance: float | None,
        obstacles: Obstacles,
        signed: bool,
        threads: int,
    ) -> None:
        check_numbers(max_distance=max_distance)
        if max_distance is not None and not max_distance > 0.0:
            raise ConfigError(f"max_distance is a length above 0 [m], got {max_distance}")
        check_threads(threads)
        self.ndim, self.resolution = view.ndim, view.resolution
        self.signed, self.max_distance = signed, max_distance
        self._obstacles, self._given = obstacles, box
        self._watch: Watch | None = None
        self.map_from_cells = view._map_from_cells()
        self._reach: int | None = None
        if max_distance is not None and max_distance < math.inf:
            cells = max_distance / view.resolution
            if cells >= FAR:
                raise ConfigError(
                    f"max_distance {in_metres(max_distance)} m is {cells:.3g} cells, more than "
                    "2^30: None asks for any distance"
                )
            # 0.3 / 0.1 is a little less than 3.
            self._reach = math.floor(cells * cells * (1.0 + 1e-12))
        self._compute(view, threads)

    def __getstate__(self) -> dict[str, Any]:
        """What pickle and copy take: not the map, which is told from a copy by its states."""
        return {**self.__dict__, "_watch": None}

    def _compute(self, view: View, threads: int) -> None:
        self._whole, self._watch = False, None  # which takes memory that few need
        self._box, self._known = self._asked(view)
        check_room(self._box.lo, self._box.hi, _BYTES)
        self._dtype = self._dtype_for(self._box, self._known)
        halo = _FIRST_HALO if self._reach is None else math.isqrt(self._reach)
        while True:
            self._read = self._to_read(self._box, self._known, halo)
            whole = self._known is None or self._read.equals(self._known)
            if self._reach is None and not whole and 2 * self._read.size > self._known_size():
                self._read, whole = self._known or self._read, True
            check_room(self._read.lo, self._read.hi, _BYTES)
            self._mask = self._obstacles.read(view, self._read)
            self._squared = self._transform(self._mask, self._read, self._box, threads)
            if self._reach is not None or whole or self._farthest() <= halo:
                break
            halo *= 4
        self._halo = None if self._reach is None and whole else halo
        self._whole = True

    def _asked(self, view: View) -> tuple[Box, Box | None]:
        """The cells to answer for, and those outside which all are unknown, with a ring of such."""
        bounds = view.bounds()
        if self._given is None and bounds is None:
            raise InputError("the map has no known cells: say with box= what distances are of")
        known = None if bounds is None else Box(*bounds)
        box = self._given or known or Box(*(np.zeros(self.ndim, np.int64),) * 2)
        return box, None if known is None else known.wider(1)

    def _known_size(self) -> int:
        return 0 if self._known is None else self._known.size

    def _to_read(self, box: Box, known: Box | None, halo: int | None) -> Box:
        """The cells whose states may matter."""
        if known is None:
            return Box(box.lo, box.lo)
        return known if halo is None else known.meet(box.wider(halo))

    def _dtype_for(self, box: Box, known: Box | None) -> npt.DTypeLike:
        spans = [int(n) for n in (box if known is None else box.hull(known)).shape]
        if self._reach is None and max(spans) >= FAR:
            raise InputError(
                f"the box and the map's cells are {max(spans):.3g} cells apart, more than 2^30: "
                "ask for a box nearer to them, or give max_distance"
            )
        largest = self._reach if self._reach is not None else sum(n * n for n in spans)
        return np.int32 if largest < none_of(np.int32) - 1 else np.int64

    def _watched(self) -> Region | None:
        """Where changes of the map may matter; None: anywhere."""
        if self._given is None or self._halo is None:
            return None
        wide = self._given.wider(self._halo)
        return wide.lo, wide.hi

    def _transform(self, mask: Mask, read: Box, box: Box, threads: int) -> Squared:
        outside = self._obstacles.outside
        found = self._one_sided(mask, read, box, outside, threads)
        if self.signed:
            inside = self._one_sided(1 - mask, read, box, 1 - outside, threads)
            np.subtract(found, inside, out=found)  # one of the two is 0
        return found

    def _one_sided(self, mask: Mask, read: Box, box: Box, outside: int, threads: int) -> Squared:
        """Squared distances to marked cells; those outside all that is known are marked or not."""
        if read.size == 0 or box.size == 0:
            return np.full(box.shape, 0 if outside else none_of(self._dtype), self._dtype)
        found = squared_to(mask, read, box, self._reach, self._dtype, threads)
        if outside and self._known is not None:
            rest = np.ones(box.shape, np.bool_)
            rest[box.meet(self._known).inside(box)] = False
            found[rest] = 0
        return found

    def _farthest(self) -> int:
        """The largest distance of a cell, rounded up to whole cells."""
        largest = _largest(self._squared)
        return FAR if largest == none_of(self._dtype) else math.isqrt(largest) + 1

    def update(self, view: View, *, threads: int = 1) -> int:
        """Take over what has been added to the map: the field is then what a new one would be.

        Only cells are worked out anew that may have another distance: those near cells that have
        become obstacles, or are none any more, as far as `max_distance`, or as the largest distance
        there is. The states of cells are compared with those that the field remembers; a view of
        log odds (without a prior map) is asked only for those whose evidence has changed.

        Args:
            view: the map, with the dimension and the resolution that it had.
            threads: how many; the result is the same.

        Returns:
            How many cells were worked out anew.

        Raises:
            InputError: no view, or one of another dimension, resolution or frame.
            MapTooLargeError: the map has grown, and the field does not fit in memory.
        """
        if not hasattr(view, "_map_from_cells"):
            raise InputError(
                "a field is updated from a view, such as grid.log_odds(), got "
                f"{type(view).__name__}"
            )
        frame = view._map_from_cells()
        if (view.ndim, view.resolution) != (self.ndim, self.resolution) or not _same(
            frame, self.map_from_cells
        ):
            raise InputError(
                f"the field is of a {self.ndim}D map with cells of {self.resolution} m, this one "
                f"is {view.ndim}D with cells of {view.resolution} m or lies elsewhere: make a new "
                "field"
            )
        box, known = self._asked(view)
        dtype = self._dtype_for(box, known)
        read = self._to_read(box, known, self._halo).hull(self._read)
        farthest = self._farthest() if self._reach is None else math.isqrt(self._reach)
        if not self._whole or dtype != self._dtype:
            self._compute(view, threads)
            return box.size
        check_room(box.lo, box.hi, _BYTES)
        check_room(read.lo, read.hi, _BYTES)
        self._whole = False
        mask = _placed(self._mask, self._read, read, self._obstacles.outside)
        where, changed = self._take_states(view, mask, read)
        if farthest >= FAR and (changed.any() or not box.equals(self._box)):
            self._compute(view, threads)
            return box.size
        halo = farthest if self._reach is not None else farthest + _FIRST_HALO // 2
        parts = boxes_to_renew(box, self._box.meet(box), where, changed, farthest, halo)
        whole = len(parts) == 1 and parts[0].equals(box)
        if not whole:
            self._squared = _placed(self._squared, self._box, box, 0)
        self._box, self._known, self._read, self._mask = box, known, read, mask
        for part in parts:
            found = self._renewed(part, halo, threads)
            if whole:
                self._squared = found
            else:
                self._squared[part.inside(box)] = found
        looked = FAR if self._reach is not None or self._halo is None else self._halo
        if parts and looked < FAR and self._farthest() > looked:
            self._compute(view, threads)
            return box.size
        self._whole = True
        return sum(part.size for part in parts)

    def _take_states(self, view: View, mask: Mask, read: Box) -> tuple[Box, BoolArray]:
        """Bring the mask up to date: where it may have changed, and whether it has."""
        region = None if self._watch is None else self._watch.changed(view)
        if region is None:
            where = read
            self._watch = view._watch(self._watched())
        else:
            where = read.meet(Box(*cell_box(*region, self.ndim)))
        new, part = self._obstacles.read(view, where), mask[where.inside(read)]
        changed = new != part
        part[...] = new
        return where, changed

    def _renewed(self, part: Box, halo: int, threads: int) -> Squared:
        """The distances of a part, from what lies around it: at first so many cells."""
        while True:
            around = self._read.meet(part.wider(halo))
            if part.equals(self._box):
                around = self._read
            mask = self._mask[around.inside(self._read)]
            found = self._transform(mask, around, part, threads)
            if self._reach is not None or around.equals(self._read):
                return found
            if _largest(found) < min(halo * halo, none_of(self._dtype)):
                return found
            halo *= 4

    @property
    def lo(self) -> IntArray:
        """The first cell of the box, shape (d,), x first."""
        return self._box.lo.copy()

    @property
    def hi(self) -> IntArray:
        """Past its last cell, shape (d,)."""
        return self._box.hi.copy()

    @property
    def nbytes(self) -> int:
        """Bytes of distances and of what `update` remembers of the map's states."""
        return int(self._squared.nbytes + self._mask.nbytes)

    @property
    def squared(self) -> Squared:
        """Squared distances [cells^2], read-only, shape (ny, nx) or (nz, ny, nx).

        Whole numbers, int32 where all of them fit, otherwise int64. `none` stands for "no obstacle
        within `max_distance`". In a signed field those of obstacles are below 0: minus the squared
        distance. `update` changes them in place.
        """
        if not self._whole:
            raise InputError("the last update of this distance field did not end: update it again")
        view = self._squared.view()
        view.flags.writeable = False
        return view

    @property
    def none(self) -> int:
        """What `squared` holds where there is no distance; in a signed field also its negative."""
        return none_of(self._dtype)

    @property
    def distance(self) -> FloatArray:
        """Distances [m], in the shape of `squared`; infinite where there is none."""
        return self._in_metres(self.squared)

    def _thumbnail(self) -> Thumbnail | None:
        if self.ndim != 2 or not self._squared.size:
            return None
        return of_quantity(self.distance, "distance to the nearest obstacle [m]")

    def plot(self, ax: Axes | None = None, **options: Unpack[PlotOptions]) -> Axes:
        """Draw distances into axes of Matplotlib: see `oddsmap.plot.on_axes.plot_quantity`.

        Args:
            ax: where; None: the current axes of pyplot.
            options: title, trajectory, crop, whole, colour_bar, cmap: see
                `oddsmap.plot.on_axes.PlotOptions`.

        Raises:
            InputError: a 3D field.
        """
        from oddsmap.plot.layout import Cells
        from oddsmap.plot.on_axes import plot_quantity

        if self.ndim != 2:
            raise InputError("a plot needs a 2D field, this one is 3D")
        distance, (turn, corner) = self.distance, self.map_from_cells or (np.eye(2), np.zeros(2))
        x, y = turn @ (self.lo * self.resolution) + corner
        yaw = math.atan2(turn[1, 0], turn[0, 0])
        cells = Cells(distance, np.isfinite(distance), self.resolution, (float(x), float(y)), yaw)
        reach = "" if self.max_distance is None else f" within {self.max_distance:g} m"
        return plot_quantity(
            cells,
            ax,
            label="distance to the nearest obstacle [m]",
            missing=f"none{reach}",
            **options,
        )

    def at(self, points: npt.ArrayLike) -> FloatArray:
        """Distances at points, those of the cells that hold them.

        Args:
            points: in the map frame [m], shape (n, d), x first.

        Returns:
            Distances [m], shape (n,); NaN outside the field's box.

        Raises:
            InputError: another shape, or coordinates that are not finite or farther than 2^46 cells
                from the map's origin.
        """
        return self._at(self.cell_of(points))

    def at_cells(self, cells: npt.ArrayLike) -> FloatArray:
        """As `at`, of cells.

        Args:
            cells: cell indices, shape (n, d), x first.
        """
        return self._at(cell_indices(cells, self.ndim))

    def within(self, radius: float) -> BoolArray:
        """Cells no farther from an obstacle than a radius: obstacles that have grown by it.

        Args:
            radius: [m], at least 0, at most `max_distance`.

        Returns:
            True where the distance is at most the radius, in the shape of `squared`.

        Raises:
            ConfigError: the radius is outside its range.
        """
        check_numbers(radius=radius)
        if not radius >= 0.0 or (self.max_distance is not None and radius > self.max_distance):
            most = "" if self.max_distance is None else f" and at most {self.max_distance:g}"
            raise ConfigError(f"a radius is at least 0 [m]{most}, got {radius}")
        limit = (radius / self.resolution) ** 2 * (1.0 + 1e-12)
        squared = self.squared
        return np.asarray((squared <= limit) & (squared != self.none))

    def _at(self, cells: IntArray) -> FloatArray:
        found = np.full(len(cells), np.nan)
        inside = ((cells >= self._box.lo) & (cells < self._box.hi)).all(axis=1)
        place = tuple((cells[inside] - self._box.lo).T[::-1])
        found[inside] = self._in_metres(self.squared[place])
        return found

    def _in_metres(self, squared: Squared) -> FloatArray:
        size = np.abs(squared).astype(np.float64)
        size[np.abs(squared) == self.none] = np.inf
        root: FloatArray = np.sqrt(size) * self.resolution
        return np.copysign(root, squared, out=root) if self.signed else root


def box_given(view: View, box: Region | None, region: Region | None) -> Box | None:
    """The cells of a box in metres, or those named; None where neither is said.

    Raises:
        InputError: both are said, one is no box, or the map's cells do not lie along its frame.
    """
    if box is not None and region is not None:
        raise InputError("give box= in metres or region= in cells, not both")
    if region is not None:
        return Box(*cell_box(*region, view.ndim))
    if box is None:
        return None
    frame, corner = view._map_from_cells(), np.zeros(view.ndim)
    if frame is not None:
        if not np.array_equal(frame[0], np.eye(view.ndim)):
            raise InputError(
                "this map is turned, and its cells do not lie along a box of its frame: give "
                "region= in cells"
            )
        corner = frame[1]
    ends = [np.asarray(end, np.float64) for end in box]
    return Box(*box_cells(ends[0] - corner, ends[1] - corner, view.resolution, view.ndim))


def _placed(array: Squared, have: Box, want: Box, fill: int) -> Squared:
    """The array of another box, what is new in it filled."""
    if have.equals(want):
        return array
    new = np.full(want.shape, fill, array.dtype)
    both = have.meet(want)
    if both.size:
        new[both.inside(want)] = array[both.inside(have)]
    return new


def _largest(squared: Squared) -> int:
    return max(int(squared.max(initial=0)), -int(squared.min(initial=0)))


def _same(
    one: tuple[FloatArray, FloatArray] | None, other: tuple[FloatArray, FloatArray] | None
) -> bool:
    if one is None or other is None:
        return one is other
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
