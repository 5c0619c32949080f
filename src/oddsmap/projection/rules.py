# SPDX-License-Identifier: Apache-2.0
"""What is said of a column by its cells in a band of heights: two rules.

The question is whether anything in the column is in the way. `by_slabs` answers it:

1. A cell that was hit more than it was passed speaks for itself: the column is as occupied as the
   most occupied of its cells. What stands there is kept, whatever was seen above or below it.
2. Otherwise the band is cut into slabs of about 0.3 m, and each is one question: beams that went
   through different cells of a slab add up, as if it were one cell. So it does not matter how
   finely a slab is cut.
3. The column is as occupied as the slab of which the least is known to be free. A slab that no
   beam crossed has the prior, and is not free: what is hidden behind a crate, or between two rings
   of a lidar, may be in the way.

`by_largest` takes the largest probability of the seen cells. It asks for enough passes in each of
them, and for nothing where none was seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.projection.band import Band
from oddsmap.projection.columns import Columns

__all__ = ["Cells", "Judged", "by_largest", "by_slabs"]

Cells = Callable[[tuple[int, int]], Iterator[tuple[IntArray, FloatArray]]]
"""Lists the known cells between two indices along z, others perhaps among them: index and log
odds, some at a time."""

# Slabs that are added up at a time: 8 bytes a column for each.
_AT_ONCE = 4
# Log odds this near the prior's are no evidence: sums of logarithms that cancel out leave 1e-16.
_NONE = 1e-9


@dataclass(frozen=True, slots=True)
class Judged:
    """What a rule says of each column, arrays of shape (n,).

    Args:
        log_odds: of the column; of no meaning where nothing is known.
        known: whether any of its cells in the band was seen.
        doubted: whether a cell is rather occupied than free (by slabs only).
        gaps: whether a slab at the bottom, between seen ones, at the top was never seen, shape
            (3, n) (by slabs only).
    """

    log_odds: FloatArray
    known: BoolArray
    doubted: BoolArray | None = None
    gaps: BoolArray | None = None


def by_largest(cells: Cells, columns: Columns, band: Band) -> Judged:
    """A column is as occupied as the most occupied of its seen cells."""
    largest = np.full(columns.count, -math.inf)
    seen = np.zeros(columns.count, np.bool_)
    for index, log_odds in cells(band.heights(band.first, band.past)):
        column = columns.number(index)
        inside = band.holds(band.layer_of(index), column)
        np.maximum.at(largest, column[inside], log_odds[inside])
        seen[column[inside]] = True
    return Judged(largest, seen)


def by_slabs(cells: Cells, columns: Columns, band: Band, height: float, prior: float) -> Judged:
    """A column is as occupied as the slab of it that is least known to be free.

    Where the band has no lower or no upper end, only the slabs between the lowest and the highest
    that were seen are asked for.

    Args:
        cells: of the map.
        columns: of the map.
        band: what counts of them.
        height: of a slab [m]; 0: a cell, inf: the whole band. A column's cells are divided among
            slabs as evenly as cells allow.
        prior: log odds of a cell that nothing is known of.
    """
    against = np.full(columns.count, -math.inf)
    least = np.full(columns.count, -math.inf)
    lowest, highest = np.zeros(columns.count, np.int32), np.full(columns.count, -1, np.int32)
    count = np.zeros(columns.count, np.int32)
    slabs = _slab_count(band, height)
    for first in range(*_slabs_in_map(band, slabs), _AT_ONCE):
        past = first + _AT_ONCE
        sums = np.zeros((columns.count, _AT_ONCE))
        seen = np.zeros((columns.count, _AT_ONCE), np.bool_)
        for index, log_odds in cells(_layers_of(band, slabs, first, past)):
            column, layer = columns.number(index), band.layer_of(index)
            inside = band.holds(layer, column)
            column, evidence = column[inside], log_odds[inside] - prior
            slab = _slab_of(band, slabs, layer[inside], column) - first
            here = (slab >= 0) & (slab < _AT_ONCE)
            column, slab, evidence = column[here], slab[here], evidence[here]
            seen[column, slab] = True
            speaks = evidence > -_NONE
            np.maximum.at(against, column[speaks], log_odds[inside][here][speaks])
            place = column * _AT_ONCE + slab
            np.add.at(sums.reshape(-1), place[~speaks], evidence[~speaks])
        for number in range(_AT_ONCE):
            has = seen[:, number]
            np.maximum(least, sums[:, number], out=least, where=has)
            np.copyto(lowest, first + number, where=has & (count == 0))
            np.copyto(highest, first + number, where=has)
            count += has
    known = count > 0
    gaps = np.stack([lowest > 0, count < highest - lowest + 1, highest < slabs - 1]) & known
    # No end, nothing to be asked for beyond what was seen.
    gaps[0] &= band.has_low
    gaps[2] &= band.has_high
    least[gaps.any(axis=0)] = 0.0
    doubted = against > -math.inf
    return Judged(np.where(doubted, against, prior + least), known, doubted, gaps)


def _slab_count(band: Band, height: float) -> npt.NDArray[np.int64]:
    """How many slabs the cells of each column make; none where it has none."""
    cells = band.past - band.first
    with np.errstate(divide="ignore", invalid="ignore"):
        wanted = np.rint(cells * band.resolution / height)
    return np.clip(np.where(np.isnan(wanted), 0, wanted), np.minimum(cells, 1), cells).astype(
        np.int64
    )


def _slabs_in_map(band: Band, slabs: IntArray) -> tuple[int, int]:
    """The first slab that has layers of the map in some column, and past the last."""
    first, past = np.maximum(band.first, 0), np.minimum(band.past, band.layers) - 1
    some = np.flatnonzero(past >= first)
    if not len(some):
        return 0, 0
    each = some if len(slabs) > 1 else np.zeros(1, np.int64)
    low, high = (_slab_of(band, slabs, layer[each], each) for layer in (first, past))
    return int(low.min()), int(high.max()) + 1


def _slab_of(band: Band, slabs: IntArray, layer: IntArray, column: IntArray) -> IntArray:
    first, past = band.of(band.first, column), band.of(band.past, column)
    # Where slabs cannot be alike the lowest have a cell less: low things stand on the ground.
    return np.asarray(((layer - first + 1) * band.of(slabs, column) - 1) // (past - first))


def _layers_of(band: Band, slabs: IntArray, first: int, past: int) -> tuple[int, int]:
    """Between which layers the slabs of these numbers lie."""
    cells, most = band.past - band.first, np.maximum(slabs, 1)
    low, high = np.minimum(first, slabs), np.minimum(past, slabs)
    return band.heights(band.first + low * cells // most, band.first + high * cells // most)
