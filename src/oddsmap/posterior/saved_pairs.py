# SPDX-License-Identifier: Apache-2.0
"""Pairs of counts of a saved map, in the memory of one shard."""

from __future__ import annotations

from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.saved_totals import SavedTotals
from oddsmap.posterior.count_pairs import CountPairs, PairCounter

__all__ = ["TotalsWithPairs"]


class TotalsWithPairs(SavedTotals):
    """What is in a saved map, and how many cells have which counts: for `read_totals`."""

    def __init__(self) -> None:
        super().__init__()
        self._counter = PairCounter()

    def add(self, part: Evidence) -> None:
        """Count and sum a part of the map."""
        super().add(part)
        self._counter.add_map(part)

    def pairs(self) -> CountPairs:
        """The pairs of counts."""
        return self._counter.pairs()
