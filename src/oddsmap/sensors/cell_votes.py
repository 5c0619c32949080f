# SPDX-License-Identifier: Apache-2.0
"""What the readings of a sensor say about single cells: what is passed from a sensor to the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["CellVotes"]


@dataclass(frozen=True, slots=True, eq=False)
class CellVotes:
    """The votes of usable scans, each of them whole.

    A sensor gives some of these for a batch, one after another, so that memory stays bounded where
    a reading is about many cells. The arrays may be used again for the next.

    Args:
        offsets: first entry of each scan, and the end, shape (scans + 1,).
        index: cells, shape (m, d), x first; a cell may occur many times in a scan.
        hits: weights in units of 1/65536 vote, shape (m,).
        passes: likewise.
        beams: how many readings were used in all.
    """

    offsets: npt.NDArray[np.int64]
    index: npt.NDArray[np.int64]
    hits: npt.NDArray[np.int64]
    passes: npt.NDArray[np.int64]
    beams: int
