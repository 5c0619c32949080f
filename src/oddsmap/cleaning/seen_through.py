# SPDX-License-Identifier: Apache-2.0
"""Which cells are dynamic: something was met there, and most scans have seen through.

A cell that a scan meets has a hit of it, one that a scan sees through has a pass. The share of
scans that meet it, its reflectivity r, has the posterior Beta(1/2 + hits, 1/2 + passes). With the
credible interval of that,

- a cell *stands* where the lower end is above 1/2, and something was met;
- a cell is *seen through* where the upper end is below 1/2;
- a cell is *dynamic* where it is seen through, and no cell beside it or above it stands.

The last is for rays that graze: a surface seen at a flat angle has cells through whose outer part
rays pass on their way to the surface itself, a step farther. Beside such a cell the surface stands.
Where something moved there is free space all around, apart from the ground beneath it, which has a
rule of its own (`cleaner.py`): cells below do not count here.

In 3D that is 8 neighbours in the cell's own layer and 9 in the layer above, in 2D the 8 around it.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.evidence.evidence import Evidence
from oddsmap.kernels.units import ONE

__all__ = ["dynamic_cells", "share_below_half"]

# Jeffreys' prior: one hit or pass alone decides at a level of 50 %, none does at 95 %.
_PRIOR = 0.5


def share_below_half(hits: IntArray, passes: IntArray) -> FloatArray:
    """P(r < 1/2): how sure it is that most scans see through a cell.

    The upper end of a credible interval of some level is below 1/2 where this is above
    (1 + level) / 2, the lower end is above 1/2 where it is below (1 - level) / 2: one number in
    place of two inverse functions.

    Args:
        hits: units of 1/65536 vote, shape (n,).
        passes: likewise.
    """
    from scipy.special import betainc

    # Most cells share few pairs of counts.
    pairs, which = np.unique(hits + 1j * passes, return_inverse=True)
    h, p = pairs.real / ONE, pairs.imag / ONE
    return np.asarray(betainc(_PRIOR + h, _PRIOR + p, 0.5)[which.ravel()])


def dynamic_cells(evidence: Evidence, cells: IntArray, level: float) -> BoolArray:
    """Which cells are dynamic.

    Args:
        evidence: the map.
        cells: cell indices, shape (n, d), each best given once.
        level: of the credible interval.

    Returns:
        True where one is, shape (n,); never where nothing was seen.
    """
    hits, passes = evidence.tiles.at(cells)
    below = share_below_half(hits, passes)
    dynamic = (below > (1.0 + level) / 2.0) & (passes > 0)
    candidates = np.flatnonzero(dynamic)
    for step in _around(cells.shape[1]):
        left = candidates[dynamic[candidates]]
        hits, passes = evidence.tiles.at(cells[left] + step)
        stands = (share_below_half(hits, passes) < (1.0 - level) / 2.0) & (hits > 0)
        dynamic[left[stands]] = False
    return dynamic


def _around(d: int) -> list[IntArray]:
    """Steps to the neighbours that count: beside and, in 3D, above."""
    steps = [np.array(step, np.int64) for step in product((-1, 0, 1), repeat=d) if any(step)]
    return [step for step in steps if d == 2 or step[2] >= 0]
