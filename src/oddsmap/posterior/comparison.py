# SPDX-License-Identifier: Apache-2.0
"""Two maps beside each other, cell by cell: where they agree, and what is different.

States are compared as each view decides them. How probably a cell has really changed, given the
readings of both periods, is another question: `oddsmap.changed` answers that.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.cell_index import check_room
from oddsmap.errors import InputError
from oddsmap.evidence.arithmetic import how_to_match
from oddsmap.kernels.units import ONE
from oddsmap.odds import sigmoid
from oddsmap.posterior.count_view import CountView
from oddsmap.short_repr import short_repr

__all__ = ["Comparison", "Kind", "PlaneOfKinds", "compare", "kinds_in_plane"]

FREE, UNDECIDED, OCCUPIED = range(3)


class Kind(IntEnum):
    """What two maps say of a cell; of several cells, the largest is what should be seen first."""

    UNKNOWN = 0
    FREE = 1
    UNDECIDED = 2
    """Known in both, undecided in one of them or in both."""
    FIRST_ALONE = 3
    SECOND_ALONE = 4
    OCCUPIED = 5
    GONE = 6
    """Occupied in the first, free in the second."""
    NEW = 7
    """Free in the first, occupied in the second."""


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Two maps beside each other.

    Args:
        states: cells known in both, by their state in the first (row) and in the second (column):
            free, undecided, occupied; shape (3, 3).
        first_alone: cells known in the first map alone.
        second_alone: cells known in the second alone.
        mean: of the log odds in the second less those in the first, over the cells known in both;
            NaN where there is none.
        rms: root of the mean square of these differences; likewise.
        largest: the largest absolute difference; likewise.
    """

    states: IntArray
    first_alone: int
    second_alone: int
    mean: float
    rms: float
    largest: float

    __repr__ = short_repr

    @property
    def both(self) -> int:
        """Cells known in both maps."""
        return int(self.states.sum())

    @property
    def same(self) -> int:
        """Those of them that have the same state in both."""
        return int(np.trace(self.states))

    @property
    def agreement(self) -> float:
        """Share of the cells known in both with the same state; NaN where there is none."""
        return self.same / self.both if self.both else math.nan

    @property
    def decided(self) -> int:
        """Cells that are free or occupied in both."""
        return int(self.states[::2, ::2].sum())

    @property
    def decided_agreement(self) -> float:
        """Share of these with the same state; NaN where there is none."""
        same = int(self.states[FREE, FREE] + self.states[OCCUPIED, OCCUPIED])
        return same / self.decided if self.decided else math.nan

    @property
    def new(self) -> int:
        """Cells free in the first map and occupied in the second."""
        return int(self.states[FREE, OCCUPIED])

    @property
    def gone(self) -> int:
        """Cells occupied in the first map and free in the second."""
        return int(self.states[OCCUPIED, FREE])


def compare(first: CountView, second: CountView) -> Comparison:
    """Compare two maps of one frame cell by cell.

    Args:
        first: a view of a map, with its thresholds.
        second: a view of the other.

    Raises:
        InputError: the maps differ in resolution or dimensions, or these are no such views.
    """
    _check(first, second)
    states = np.zeros((3, 3), np.int64)
    total = square = largest = 0.0
    for _, one, other in _known_in_both(first, second):
        pairs = 3 * _state(first, one) + _state(second, other)
        states += np.bincount(pairs, minlength=9).reshape(3, 3)
        change = other - one
        total += float(change.sum())
        square += float((change**2).sum())
        largest = max(largest, float(np.abs(change).max(initial=0.0)))
    both = int(states.sum())
    return Comparison(
        states=states,
        first_alone=first.evidence.cell_count() - both,
        second_alone=second.evidence.cell_count() - both,
        mean=total / both if both else math.nan,
        rms=math.sqrt(square / both) if both else math.nan,
        largest=largest if both else math.nan,
    )


class PlaneOfKinds(NamedTuple):
    """What two 2D maps say of the cells of a box."""

    kinds: npt.NDArray[np.uint8]
    """`Kind` of each cell, shape (ny, nx)."""
    first_cell: IntArray
    """Index of the first, x first."""


def kinds_in_plane(first: CountView, second: CountView) -> PlaneOfKinds:
    """What two 2D maps say of each cell that one of them knows.

    Raises:
        InputError: as in `compare`, the maps are 3D, or neither knows a cell.
        MapTooLargeError: the box of both does not fit in memory.
    """
    _check(first, second)
    boxes = [box for view in (first, second) if (box := view.bounds()) is not None]
    if first.ndim != 2:
        raise InputError("a picture needs 2D maps, these are 3D")
    if not boxes:
        raise InputError("neither map knows a cell, there is nothing to draw")
    lo = np.min([low for low, _ in boxes], axis=0)
    hi = np.max([high for _, high in boxes], axis=0)
    check_room(lo, hi, 8)
    kinds = np.zeros(tuple((hi - lo)[::-1]), np.uint8)
    for view, alone in ((first, Kind.FIRST_ALONE), (second, Kind.SECOND_ALONE)):
        for index, _, _ in view.evidence.tiles.parts():
            kinds[tuple((index - lo).T[::-1])] = alone
    table = np.full((3, 3), Kind.UNDECIDED, np.uint8)
    table[::2, ::2] = [[Kind.FREE, Kind.NEW], [Kind.GONE, Kind.OCCUPIED]]
    for index, one, other in _known_in_both(first, second):
        of_both = table[_state(first, one), _state(second, other)]
        kinds[tuple((index - lo).T[::-1])] = of_both
    return PlaneOfKinds(kinds, lo)


def _known_in_both(
    first: CountView, second: CountView
) -> Iterator[tuple[IntArray, FloatArray, FloatArray]]:
    """The cells with evidence in both, some at a time: index and log odds in each."""
    for index, hits, passes in first.evidence.tiles.parts():
        their_hits, their_passes = second.evidence.tiles.at(index)
        both = (their_hits > 0) | (their_passes > 0)
        cells = index[both]
        yield (
            cells,
            first.of_votes(hits[both] / ONE, passes[both] / ONE, first.prior_at(cells)),
            second.of_votes(
                their_hits[both] / ONE, their_passes[both] / ONE, second.prior_at(cells)
            ),
        )


def _state(view: CountView, log_odds: FloatArray) -> IntArray:
    p, limits = sigmoid(log_odds), view.thresholds
    return np.where(p <= limits.free, FREE, np.where(p >= limits.occupied, OCCUPIED, UNDECIDED))


def _check(first: object, second: object) -> None:
    if not (isinstance(first, CountView) and isinstance(second, CountView)):
        raise InputError(
            "compare takes two views of hits and passes: give grid.log_odds() or "
            f"grid.calibrated(), got {type(first).__name__} and {type(second).__name__}"
        )
    if first.ndim != second.ndim:
        raise InputError(
            f"a {first.ndim}D map cannot be compared with a {second.ndim}D map cell by cell"
        )
    if first.resolution != second.resolution:
        raise InputError(
            f"maps of different resolution cannot be compared cell by cell: {first.resolution:g} m "
            f"and {second.resolution:g} m; {how_to_match(first.resolution, second.resolution)}"
        )
