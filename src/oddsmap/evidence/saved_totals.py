# SPDX-License-Identifier: Apache-2.0
"""What is in a saved map, counted and summed in the memory of one shard."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TypeVar

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.store import read_once
from oddsmap.map_files.zarr_snapshot import read_unchanged

__all__ = ["SavedTotals", "read_totals"]


class SavedTotals:
    """What is in a saved map; made to be derived from.

    Attributes:
        like: an empty map of the same configuration and provenance.
        cells: how many cells have evidence.
        hits: their sum, in units of 1/65536 vote.
        passes: likewise.
        bounds: as `Evidence.bounds`.
    """

    like: Evidence

    def __init__(self) -> None:
        self.cells = self.hits = self.passes = 0
        self.bounds: tuple[IntArray, IntArray] | None = None

    def add(self, part: Evidence) -> None:
        """Count and sum a part of the map; no cell is in two of them."""
        census, bounds = part.census(), part.bounds()
        self.cells += census.cells
        self.hits += census.hits
        self.passes += census.passes
        if self.bounds is None or bounds is None:
            self.bounds = self.bounds or bounds
        else:
            (lo, hi), (other_lo, other_hi) = self.bounds, bounds
            self.bounds = np.minimum(lo, other_lo), np.maximum(hi, other_hi)


T = TypeVar("T", bound=SavedTotals)


def read_totals(path: str | os.PathLike[str], kind: type[T]) -> T:
    """Count and sum what is in a map that `save_map` wrote; errors as in `read_map`.

    Args:
        path: the map.
        kind: what to make of it, `SavedTotals` or one that knows more.
    """

    def read() -> T:
        totals = kind()
        totals.like = read_once(Path(path), Evidence, None, None, take=totals.add)
        return totals

    return read_unchanged(Path(path), read)
