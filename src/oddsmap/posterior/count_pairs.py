# SPDX-License-Identifier: Apache-2.0
"""How many cells have which hits and passes: all that a model of counts is fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.saved_totals import SavedTotals
from oddsmap.kernels.units import ONE

__all__ = [
    "FEW_PAIRS",
    "CountPairs",
    "PairCounter",
    "TotalsWithPairs",
    "count_pairs",
    "few_pairs",
]

# Weights that fade or are shared have few pairs in common; beyond this many they are rounded to a
# sixteenth of a vote, which no fit can tell from themselves.
_MAX_PAIRS = 1 << 18
_SIXTEENTH = ONE // 16
# A distribution on a grid is fitted to no more pairs than this: half a second.
FEW_PAIRS = 10_000
# Tiles with weights beyond a byte that are looked at together: 2 to 4 million cells.
_WIDE_TILES = 4096
_MOST_DIGITS, _LEAST_DIGITS = 7, 2  # binary


@dataclass(frozen=True, slots=True, eq=False)
class CountPairs:
    """The pairs of counts that occur in a map, in ascending order, hits first.

    Args:
        hits: weight of hits [votes], shape (n,).
        passes: weight of passes [votes], shape (n,).
        cells: how many cells have both, shape (n,).
    """

    hits: FloatArray
    passes: FloatArray
    cells: FloatArray


def count_pairs(evidence: Evidence) -> CountPairs:
    """Count the cells with evidence by their hits and passes.

    The same counts give the same pairs, whatever the order and the tiles they are in.
    """
    found = PairCounter()
    found.add_map(evidence)
    return found.pairs()


def few_pairs(pairs: CountPairs, most: int = FEW_PAIRS) -> CountPairs:
    """Pairs of counts that are rounded to fewer binary digits, as few as make them few.

    Args:
        pairs: the counts of a map.
        most: how many are few.

    Returns:
        The same, where there are few; else rounded counts, as exact as can be.
    """
    digits = _MOST_DIGITS
    few = pairs
    while len(few.cells) > most and digits >= _LEAST_DIGITS:
        keys, place = np.unique(
            _rounded(pairs.hits, digits) + 1j * _rounded(pairs.passes, digits), return_inverse=True
        )
        cells = np.bincount(place, pairs.cells, len(keys)).astype(np.float64)
        few, digits = CountPairs(keys.real, keys.imag, cells), digits - 1
    return few


def _rounded(weights: FloatArray, digits: int) -> FloatArray:
    mantissa, exponent = np.frexp(weights)
    return np.asarray(np.ldexp(np.rint(np.ldexp(mantissa, digits)), exponent - digits))


class PairCounter:
    """Pairs of weights [1/65536 vote] with their numbers, as parts of a map are added."""

    def __init__(self) -> None:
        self._table = np.zeros(1 << 16, np.int64)  # of whole votes below 256
        self._hits = np.empty(0, np.int64)
        self._passes = np.empty(0, np.int64)
        self._cells = np.empty(0, np.int64)

    def add(self, hits: IntArray, passes: IntArray) -> None:
        """Count cells of these weights [1/65536 vote], shape (n,) each."""
        whole = ((hits | passes) % ONE == 0) & ((hits | passes) < 256 * ONE)
        small = (hits[whole] // ONE << 8) | (passes[whole] // ONE)
        self._table += np.bincount(small, minlength=len(self._table))
        rest = ~whole
        if rest.any():
            ones = np.ones(np.count_nonzero(rest), np.int64)
            self._merge(hits[rest], passes[rest], ones)

    def add_table(self, table: IntArray) -> None:
        """Count cells of whole votes: how many, at 256 * hits + passes, shape (65536,)."""
        self._table += table
        self._table[0] = 0  # cells without evidence, which tiles hold among the others

    def add_map(self, part: Evidence) -> None:
        """Count the known cells of a part of a map."""
        from oddsmap.kernels.vote.pair_table import tabulate_pairs

        tiles = part.tiles
        tabulate_pairs(tiles.arrays, self._table)
        self._table[0] = 0  # cells without evidence, which tiles hold among the others
        wide = np.flatnonzero(tiles.arrays.wide_of[: tiles.count] >= 0)
        for begin in range(0, len(wide), _WIDE_TILES):
            units = tiles.units(wide[begin : begin + _WIDE_TILES])
            hits, passes = units[:, 0].ravel(), units[:, 1].ravel()
            known = (hits | passes) > 0
            self.add(hits[known], passes[known])

    def pairs(self) -> CountPairs:
        """What has been counted."""
        small = np.flatnonzero(self._table)
        self._merge((small >> 8) * ONE, (small & 255) * ONE, self._table[small])
        self._table[:] = 0
        if len(self._cells) > _MAX_PAIRS:
            self._hits = (self._hits + _SIXTEENTH // 2) // _SIXTEENTH * _SIXTEENTH
            self._passes = (self._passes + _SIXTEENTH // 2) // _SIXTEENTH * _SIXTEENTH
            nothing = np.empty(0, np.int64)
            self._merge(nothing, nothing, nothing)
        cells = self._cells.astype(np.float64)
        return CountPairs(self._hits / ONE, self._passes / ONE, cells)

    def _merge(self, hits: IntArray, passes: IntArray, cells: IntArray) -> None:
        hits = np.concatenate([self._hits, hits])
        passes = np.concatenate([self._passes, passes])
        cells = np.concatenate([self._cells, cells])
        order = np.lexsort((passes, hits))
        hits, passes, cells = hits[order], passes[order], cells[order]
        new = np.ones(len(hits), np.bool_)
        new[1:] = (np.diff(hits) != 0) | (np.diff(passes) != 0)
        first = np.flatnonzero(new)
        self._hits, self._passes = hits[first], passes[first]
        self._cells = np.add.reduceat(cells, first) if len(first) else cells


class TotalsWithPairs(SavedTotals):
    """What is in a map by parts, with its pairs of counts."""

    def __init__(self) -> None:
        super().__init__()
        self.counter = PairCounter()

    def add(self, part: Evidence) -> None:
        """Count and sum a part of the map; no cell is in two of them."""
        super().add(part)
        self.counter.add_map(part)
