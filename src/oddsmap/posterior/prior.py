# SPDX-License-Identifier: Apache-2.0
"""Prior maps: what is believed of each cell before any reading.

The Bayes filter subtracts the prior's log odds from each update, so that a cell outside the beam
keeps its prior, whatever that is. With evidence kept as counts the prior appears once:

    l = logit(prior of the cell) + l_occ * hits - l_free * passes

and any map can be that prior: it is looked up at the centre of each cell.

Source: Thrun, Burgard, Fox: Probabilistic Robotics (2005), table 9.1 and equation 9.7.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.cell_index import cell_box, cell_indices, check_room, one_cell
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.lookup import floor_cells, same_places
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.maps.voxel_map import VoxelMap
from oddsmap.odds import logit
from oddsmap.short_repr import short_repr

__all__ = ["PRIOR_LIMIT", "FilterView", "MapLike", "PriorArray", "PriorMap", "PriorSource"]


PRIOR_LIMIT = 1e-6
"""Probabilities of a prior map are clipped to [1e-6, 1 - 1e-6]: no evidence changes 0 or 1."""

# What a region takes a cell: one number. Its cells are looked up so many at a time, which bounds
# the memory that their indices take.
_REGION_BYTES = 8
_SLAB_CELLS = 1 << 20


@dataclass(frozen=True, slots=True, eq=False)
class PriorArray:
    """A prior as an array, of cells as large as the map's.

    Args:
        probability: p(x), shape (ny, nx) or (nz, ny, nx), axes ascending; NaN where not known.
        first: index of its first cell in the map, shape (d,), x first.

    Raises:
        InputError: another shape, or values outside [0, 1].
    """

    probability: FloatArray
    first: npt.ArrayLike

    __repr__ = short_repr

    def __post_init__(self) -> None:
        p = np.asarray(self.probability, np.float64)
        if p.ndim not in (2, 3) or np.shape(self.first) != (p.ndim,):
            raise InputError(
                "a prior array needs shape (ny, nx) with a first cell (x, y), or (nz, ny, nx) with "
                f"(x, y, z), got {p.shape} and {self.first!r}"
            )
        first = one_cell(self.first, p.ndim)
        _check_probabilities(p)
        object.__setattr__(self, "probability", p)
        object.__setattr__(self, "first", first)


@runtime_checkable
class FilterView(Protocol):
    """A view of the Bayes filter, as `LogOdds` is."""

    evidence: Evidence

    def log_odds(self, region: Region | None = None) -> FloatArray:
        """Log odds of a region's cells."""

    def log_odds_at(self, index: npt.ArrayLike) -> FloatArray:
        """Log odds of single cells, wherever they lie."""


PriorSource: TypeAlias = ProbabilityMap | PriorArray | FilterView | VoxelMap
"""What a prior is read from."""

MapLike: TypeAlias = PriorSource | Evidence
"""What may be given as a prior: evidence counts under its own sensor model."""


class PriorMap:
    """Log odds of the prior for each cell of a map.

    - `ProbabilityMap` (a ROS map, too): the cell of it that holds the centre of the map's cell;
      its resolution, origin and yaw are its own.
    - `LogOdds`: its log odds at that cell, also where it has no evidence itself, where they are
      its own prior's: its prior, its evidence and then the map's evidence, in the Bayes filter's
      order. Nothing is clipped; give it a `clamp` to soften an old map.
    - `EvidenceMap`: its evidence under its own sensor model, on top of the uniform prior.
    - `VoxelMap`: the leaf that holds the centre, likewise; for 3D maps.
    - `PriorArray`: the same cells.

    Cells unknown to the source have the uniform prior. Probabilities are clipped to
    [1e-6, 1 - 1e-6]: no evidence could change 0 or 1. A centre on the border of two cells, as
    with a source half as coarse, belongs to the upper one.

    Args:
        source: where the prior comes from; what is added to it later shows.
        evidence: the map that the prior is for.
        uniform: p(x) of cells that the source does not know.

    Raises:
        InputError: the source has another number of dimensions, is no map, is the map itself, or
            has probabilities outside [0, 1].
    """

    def __init__(self, source: PriorSource, evidence: Evidence, uniform: float) -> None:
        if isinstance(source, FilterView) and source.evidence is evidence:
            raise InputError("a map cannot be its own prior: its evidence would count twice")
        self.uniform = float(logit(uniform))
        self.ndim = evidence.ndim
        self._known, ndim = _reader(source, evidence.resolution)
        # Cells that are the same need no look-up one by one.
        self._same = None
        if isinstance(source, FilterView) and source.evidence.resolution == evidence.resolution:
            self._same = source
        if ndim != self.ndim:
            raise InputError(
                f"the prior is a {ndim}D map, this map is {self.ndim}D; "
                f"give a prior of {self.ndim} dimensions"
            )

    def at(self, index: IntArray) -> FloatArray:
        """Log odds of cells, shape (n,); index has shape (n, d), x first."""
        known = self._known(cell_indices(index, self.ndim))
        return np.where(np.isnan(known), self.uniform, known)

    def region(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> FloatArray:
        """Log odds of a box of cells, shape (ny, nx) or (nz, ny, nx); hi past the last cell."""
        first, last = cell_box(lo, hi, self.ndim)
        check_room(first, last, _REGION_BYTES)
        if self._same is not None:
            return self._same.log_odds((first, last))
        shape = tuple(int(n) for n in (last - first)[::-1])
        values = np.empty(math.prod(shape))
        for start in range(0, len(values), _SLAB_CELLS):
            number = np.arange(start, min(start + _SLAB_CELLS, len(values)))
            index = np.stack(np.unravel_index(number, shape)[::-1], axis=1) + first
            values[number] = self.at(index)
        return values.reshape(shape)


def _reader(source: PriorSource, resolution: float) -> tuple[Callable[[IntArray], FloatArray], int]:
    """How to read a source: cells to log odds, NaN where it knows nothing; its dimensions."""
    if isinstance(source, ProbabilityMap):
        return _grid_reader(source, resolution), 2
    if isinstance(source, PriorArray):
        first = np.asarray(source.first, np.int64)
        values = _clipped_logit(source.probability)
        return lambda index: _pick(values, index - first), len(first)
    if isinstance(source, FilterView):
        view, side = source, source.evidence.resolution
        return (
            lambda index: view.log_odds_at(same_places(index, resolution, side)),
            view.evidence.ndim,
        )
    if isinstance(source, VoxelMap):
        voxels = source
        padded = np.append(voxels.log_odds, np.nan)  # [-1], in no leaf, is the last
        return (
            lambda index: padded[voxels.find(same_places(index, resolution, voxels.resolution))],
            3,
        )
    raise InputError(
        "a prior is a probability, a ProbabilityMap, a LogOdds view, an EvidenceMap, a VoxelMap or "
        f"a PriorArray, got {type(source).__name__}"
    )


def _grid_reader(grid: ProbabilityMap, resolution: float) -> Callable[[IntArray], FloatArray]:
    known = np.where(grid.observed, grid.probability, np.nan)
    _check_probabilities(known)
    values = _clipped_logit(known)
    cos, sin = math.cos(grid.yaw), math.sin(grid.yaw)
    turn = np.array([[cos, -sin], [sin, cos]])  # rows of map_from_grid: its inverse from the right

    def read(index: IntArray) -> FloatArray:
        offset = (index + 0.5) * resolution - np.asarray(grid.origin)
        return _pick(values, floor_cells(offset @ turn / grid.resolution))

    return read


def _pick(values: FloatArray, index: IntArray) -> FloatArray:
    """Values of cells, x first, of an array that starts at cell 0; NaN outside it."""
    picked = np.full(len(index), np.nan)
    inside = ((index >= 0) & (index < values.shape[::-1])).all(axis=1)
    picked[inside] = values[tuple(index[inside].T[::-1])]
    return picked


def _clipped_logit(probability: FloatArray) -> FloatArray:
    return logit(np.clip(probability, PRIOR_LIMIT, 1.0 - PRIOR_LIMIT))


def _check_probabilities(probability: FloatArray) -> None:
    wrong = np.count_nonzero((probability < 0.0) | (probability > 1.0))
    if wrong:
        raise InputError(f"a prior map holds probabilities in [0, 1], {wrong} values are not")
