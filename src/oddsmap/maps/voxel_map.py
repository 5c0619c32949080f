# SPDX-License-Identifier: Apache-2.0
"""A 3D map without counts: probabilities of cubes of cells.

It is what a file without evidence (an OctoMap) arrives as: a prior, or something to compare with,
never evidence. The 3D sibling of `ProbabilityMap`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.cell_index import cell_box, cell_indices
from oddsmap.errors import InputError, MapTooLargeError
from oddsmap.map_files.fields import LeafPart, OfLogOdds, PointPart
from oddsmap.map_files.morton import MORTON_BITS, morton
from oddsmap.odds import State, Thresholds, decided_by, sigmoid
from oddsmap.plot.from_above import DrawnFromAbove
from oddsmap.query.queries import PointStates, Queries
from oddsmap.short_repr import FEW_CELLS, described, grid_facts

if TYPE_CHECKING:
    from oddsmap.map_files.octomap_range import Shift

__all__ = ["VoxelMap", "load_octomap"]


_HALF = 1 << 15
"""Maps within this many cells of the origin count their codes from there, as OctoMap does."""
_MAX_LEVEL = 15
_MAX_BOX = 1 << 31
_MAX_CELLS = 50_000_000
_PART = 1 << 16


@dataclass(frozen=True, slots=True, eq=False)
class VoxelMap(Queries, DrawnFromAbove):
    """Log odds of 3D cells; one entry, a leaf, may cover a cube of 2^k cells per side.

    Cell i covers [i * resolution, (i + 1) * resolution) in the map frame, along each axis. Cells
    in no leaf are unknown. The leaves are kept in depth-first order of an octree; that of the
    arrays given does not matter.

    Args:
        index: lowest cell of each leaf, shape (n, 3), x first.
        log_odds: of each leaf, shape (n,).
        resolution: side of a cell [m].
        level: the k of each leaf, 0 to 15, shape (n,); by default 0, single cells.

    Raises:
        InputError: shapes differ, the resolution is not positive, log odds are not finite, or
            leaves overlap or are not aligned to their size.
        MapTooLargeError: more than 2^21 cells along an axis.
    """

    index: IntArray
    log_odds: FloatArray
    resolution: float
    level: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    _base: IntArray = field(init=False, repr=False)
    _code: IntArray = field(init=False, repr=False)

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        bounds = self.bounds() if len(self.index) <= FEW_CELLS else None
        yield from grid_facts(3, self.resolution, self.cell_count, bounds)
        yield f"{self.leaf_count:,} leaves"

    def __post_init__(self) -> None:
        index = cell_indices(self.index, 3)
        log_odds = np.asarray(self.log_odds, np.float64)
        levels = np.asarray(self.level)
        if levels.shape == (0,) and levels.dtype == np.uint8:
            levels = np.zeros(len(index), np.uint8)
        if not log_odds.shape == levels.shape == (len(index),):
            raise InputError(
                f"{len(index)} leaves need log odds and levels of shape ({len(index)},), "
                f"got {log_odds.shape} and {levels.shape}"
            )
        if not 0.0 < self.resolution < float("inf"):
            raise InputError(f"a map needs a positive resolution [m], got {self.resolution}")
        if not np.isfinite(log_odds).all():
            raise InputError(f"{np.count_nonzero(~np.isfinite(log_odds))} log odds are not finite")
        if len(levels) and not 0 <= levels.min() <= levels.max() <= _MAX_LEVEL:
            raise InputError(f"levels of leaves are 0 to {_MAX_LEVEL}, got up to {levels.max()}")
        level = levels.astype(np.uint8)
        side = np.int64(1) << level.astype(np.int64)
        if (index & (side - 1)[:, None]).any():
            raise InputError("a leaf of 2^k cells per side must start at a multiple of 2^k")
        base = _base_of(index, side)
        code = morton(index - base)
        if len(code) and not (code[1:] > code[:-1]).all():
            order = np.argsort(code, kind="stable")
            index, log_odds, level, code = index[order], log_odds[order], level[order], code[order]
        if (code[:-1] + (np.int64(1) << (3 * level[:-1].astype(np.int64))) > code[1:]).any():
            raise InputError("leaves overlap: each cell may be listed once")
        fields = {
            "index": index, "log_odds": log_odds, "level": level, "_base": base, "_code": code
        }  # fmt: skip
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    @property
    def ndim(self) -> int:
        """3."""
        return 3

    @property
    def leaf_count(self) -> int:
        """How many leaves there are."""
        return len(self.index)

    @property
    def cell_count(self) -> int:
        """How many cells the leaves cover."""
        each = np.bincount(self.level, minlength=_MAX_LEVEL + 1)
        return sum(int(n) << (3 * k) for k, n in enumerate(each))

    @property
    def probability(self) -> FloatArray:
        """p(occupied) of each leaf, shape (n,)."""
        return sigmoid(self.log_odds)

    @property
    def side(self) -> IntArray:
        """Cells along the side of each leaf, shape (n,)."""
        return np.int64(1) << self.level.astype(np.int64)

    def leaf_state(self, *, thresholds: Thresholds | None = None) -> npt.NDArray[np.int8]:
        """Decide each leaf: values of `State`, shape (n,)."""
        known = np.ones(len(self.index), np.bool_)
        return decided_by(thresholds, Thresholds()).state(self.probability, known)

    def state(
        self, region: Region | None = None, *, thresholds: Thresholds | None = None
    ) -> npt.NDArray[np.int8]:
        """Decide the cells of a box, as `Belief.state` does; for leaves see `leaf_state`.

        Args:
            region: (lo, hi), x first, hi past the last cell; None: the box of known cells.
            thresholds: what is free and what is occupied; by default 0.196, 0.65.

        Returns:
            Values of `State`, `State.UNKNOWN` where no leaf is, shape (nz, ny, nx).

        Raises:
            InputError: the region is no (lo, hi) of three indices each, lo <= hi.
            MapTooLargeError: the box has more than 2^31 cells.
        """
        nothing = (np.zeros(3, np.int64),) * 2
        box = (self.bounds() or nothing) if region is None else region
        if isinstance(box, Thresholds) or [np.shape(end) for end in box] != [(3,), (3,)]:
            raise InputError(f"state takes a region (lo, hi), thresholds by name; got {box!r}")
        lo, hi = cell_box(box[0], box[1], 3)
        shape = tuple(int(n) for n in (hi - lo)[::-1])
        if math.prod(shape) > _MAX_BOX:
            raise MapTooLargeError(
                f"a box of {' x '.join(str(n) for n in shape[::-1])} cells: ask for a smaller "
                "region, or for the state of the leaves alone (leaf_state)"
            )
        state = np.full(shape, State.UNKNOWN, np.int8)
        index, probability = self.cells((lo, hi), max_cells=_MAX_BOX)
        x, y, z = (index - lo).T
        known = np.ones(len(index), np.bool_)
        state[z, y, x] = decided_by(thresholds, Thresholds()).state(probability, known)
        return state

    def leaves(self, shift: Shift | None = None) -> VoxelMap:
        """The map with another cell as cell 0; None: itself.

        Raises:
            InputError: a leaf would not start at a multiple of its size.
        """
        if shift is None or not shift.cells.any():
            return self
        largest = 1 << int(self.level.max(initial=0))
        if (shift.cells % largest).any():
            raise InputError(
                f"a map with leaves of {largest * self.resolution:g} m is shifted by multiples of "
                f"that, not by {' '.join(f'{n:.10g}' for n in shift.metres)} m"
            )
        return VoxelMap(self.index - shift.cells, self.log_odds, self.resolution, self.level)

    @property
    def base(self) -> IntArray:
        """The cell of code 0, shape (3,), x first: see `parts`."""
        return self._base

    def parts(self, function: OfLogOdds) -> Iterator[LeafPart]:
        """The leaves in order, some at a time: Morton code, level, and a function of log odds."""
        for start in range(0, len(self._code), _PART):
            part = slice(start, start + _PART)
            yield LeafPart(self._code[part], self.level[part], function(self.log_odds[part]))

    @property
    def has_counts(self) -> bool:
        """An OctoMap has no hits and passes."""
        return False

    def points(self, least: float) -> Iterator[PointPart]:
        """The leaves as points, some at a time, of at least a probability; larger ones are one."""
        for start in range(0, len(self._code), _PART):
            part = slice(start, start + _PART)
            p = sigmoid(self.log_odds[part])
            chosen = p >= least
            index = self.index[part][chosen]
            side = np.int64(1) << self.level[part][chosen].astype(np.int64)
            centre: FloatArray = (index + side[:, None] / 2) * np.float64(self.resolution)
            length: FloatArray = side * np.float64(self.resolution)
            yield PointPart(centre, length, p[chosen], None, None)

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of known cells: first index and past the last, shape (3,); None if empty."""
        if len(self.index) == 0:
            return None
        return self.index.min(axis=0), (self.index + self.side[:, None]).max(axis=0)

    def find(self, index: npt.ArrayLike) -> IntArray:
        """Which leaf holds a cell: its number, or -1 where the cell is unknown.

        Args:
            index: cells, shape (m, 3), x first.
        """
        cells = cell_indices(index, 3)
        bounds = self.bounds()
        if bounds is None:
            return np.full(len(cells), -1, np.int64)
        inside = np.all((cells >= bounds[0]) & (cells < bounds[1]), axis=1)
        code = morton(np.where(inside[:, None], cells, self.index[0]) - self._base)
        leaf = np.searchsorted(self._code, code, side="right") - 1
        end = self._code[leaf] + (np.int64(1) << (3 * self.level[leaf].astype(np.int64)))
        return np.where(inside & (leaf >= 0) & (code < end), leaf, -1)

    def state_at(
        self, index: npt.ArrayLike, *, thresholds: Thresholds | None = None
    ) -> npt.NDArray[np.int8]:
        """Decide cells: values of `State`, `State.UNKNOWN` where no leaf is; shape (m,)."""
        leaf = self.find(index)
        known = np.append(
            self.leaf_state(thresholds=thresholds), np.int8(State.UNKNOWN)
        )  # [-1] is the last
        return known[leaf]

    def _probability_at(self, cells: IntArray) -> FloatArray:
        return np.append(self.probability, np.nan)[self.find(cells)]  # [-1] is the last

    def _states_at(self, cells: IntArray, thresholds: Thresholds | None) -> PointStates:
        state = self.state_at(cells, thresholds=thresholds)
        return PointStates(cells, self._probability_at(cells), state)

    def _state_parts(
        self, thresholds: Thresholds | None, within: Region | None = None
    ) -> Iterator[tuple[IntArray, npt.NDArray[np.int8]]]:
        index, p = self.cells(within)
        yield index, decided_by(thresholds, Thresholds()).state(p, np.ones(len(p), np.bool_))

    def _probability_parts(self) -> Iterator[tuple[IntArray, FloatArray]]:
        yield self.cells()

    def cells(
        self,
        region: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
        *,
        max_cells: int = _MAX_CELLS,
    ) -> tuple[IntArray, FloatArray]:
        """Single cells: index, shape (m, 3), x first, and probability, shape (m,), leaf by leaf.

        Args:
            region: (lo, hi), hi past the last cell; None: all.
            max_cells: the most to be listed.

        Raises:
            MapTooLargeError: there are more than `max_cells`.
        """
        index, leaf = self._listed(region, max_cells)
        return index, self.probability[leaf]

    def known_log_odds(self) -> tuple[IntArray, FloatArray]:
        """As `cells`, with log odds."""
        index, leaf = self._listed(None, _MAX_CELLS)
        return index, self.log_odds[leaf]

    def _listed(
        self, region: tuple[npt.ArrayLike, npt.ArrayLike] | None, max_cells: int
    ) -> tuple[IntArray, IntArray]:
        """Single cells and the leaves that they lie in."""
        first, last = self.index, self.index + self.side[:, None]
        if region is not None:
            lo, hi = cell_box(*region, 3)
            first, last = np.maximum(first, lo), np.minimum(last, hi)
        span = np.maximum(last - first, 0)
        count = span.prod(axis=1)
        # In Python's integers: disjoint leaves could cover 2^63 cells.
        total = self.cell_count if region is None else sum(map(int, count))
        if total > max_cells:
            # Index, probability, and what it takes to get there: 64 bytes per cell.
            raise MapTooLargeError(
                f"{self.leaf_count} leaves cover {total} cells, listing them takes about "
                f"{total * 64 / 1e9:.3g} GB; ask for a region, or raise max_cells ({max_cells})"
            )
        leaf = np.repeat(np.arange(len(count)), count)
        number = np.arange(total) - np.repeat(np.cumsum(count) - count, count)
        size = span[leaf]
        index = first[leaf]
        index[:, 0] += number % size[:, 0]
        index[:, 1] += number // size[:, 0] % size[:, 1]
        index[:, 2] += number // (size[:, 0] * size[:, 1])
        return index, leaf

    def save_octomap(
        self,
        path: str | os.PathLike[str],
        *,
        clamp: tuple[float, float] | None = None,
        thresholds: Thresholds | None = None,
        shift: tuple[float, float, float] | None = None,
        force: bool = False,
    ) -> None:
        """Write an OctoMap: see `oddsmap.posterior.belief.Belief.save_octomap`."""
        from oddsmap.map_files.octomap_range import check_keys, shift_of
        from oddsmap.map_files.octomap_writer import save_octomap

        moved = None if shift is None else shift_of(shift, self.resolution)
        check_keys(Path(path), self.bounds(), self.resolution, moved)
        save_octomap(
            self.leaves(moved), Path(path), clamp=clamp, thresholds=thresholds, shift=moved,
            force=force,
        )  # fmt: skip

    def save_ply(
        self,
        path: str | os.PathLike[str],
        *,
        thresholds: Thresholds | None = None,
        force: bool = False,
    ) -> None:
        """Write the occupied leaves as points: see `oddsmap.map_files.ply.save_ply`."""
        from oddsmap.map_files.ply import save_ply

        save_ply(self, Path(path), thresholds=thresholds, force=force)

    def save_las(
        self,
        path: str | os.PathLike[str],
        *,
        crs: str | None = None,
        thresholds: Thresholds | None = None,
        force: bool = False,
    ) -> None:
        """Write the occupied leaves as LAS or LAZ: see `oddsmap.map_files.las.save_las`."""
        from oddsmap.map_files.las import save_las

        save_las(self, Path(path), crs=crs, thresholds=thresholds, force=force)

    def save_rerun(
        self,
        path: str | os.PathLike[str],
        *,
        thresholds: Thresholds | None = None,
        shift: tuple[float, float, float] | None = None,
        force: bool = False,
    ) -> None:
        """Write the occupied leaves for Rerun: see `oddsmap.map_files.rerun_file`."""
        from oddsmap.map_files.octomap_range import shift_of
        from oddsmap.map_files.rerun_file import save_rerun_space

        moved = None if shift is None else shift_of(shift, self.resolution)
        save_rerun_space(self, Path(path), thresholds=thresholds, shift=moved, force=force)


def load_octomap(path: str | os.PathLike[str]) -> VoxelMap:
    """Read an OctoMap, `.bt` or `.ot`; the content decides, not the name.

    Leaves stay as large as they are in the file. Those of a `.bt` get the log odds that OctoMap
    gives them: of p = 0.1192 where free, of p = 0.971 where occupied. Colours are left out.

    Args:
        path: the file.

    Raises:
        InputError: no such file, not an OctoMap, cut off, or damaged.
    """
    from oddsmap.map_files.octomap_reader import read_octomap

    return VoxelMap(*read_octomap(path))


def _base_of(index: IntArray, side: IntArray) -> IntArray:
    # The cell whose code is 0, aligned to the largest leaf.
    if len(index) == 0:
        return np.full(3, -_HALF, np.int64)
    lo, hi = index.min(axis=0), (index + side[:, None]).max(axis=0)
    if (lo >= -_HALF).all() and (hi <= _HALF).all():
        return np.full(3, -_HALF, np.int64)
    base = np.asarray(lo & -side.max(), np.int64)
    # By division: a difference of far indices may not fit in 64 bits.
    if ((hi - 1) // 2 - base // 2 >= 1 << (MORTON_BITS - 1)).any():
        raise MapTooLargeError(
            f"a 3D map covers at most {1 << MORTON_BITS} cells along an axis, "
            f"got {lo.tolist()} to {hi.tolist()}"
        )
    return base
