# SPDX-License-Identifier: Apache-2.0
"""A small picture of landmarks, as notebooks show it: a dot for each, without Matplotlib."""

from __future__ import annotations

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.plot.thumbnail import Thumbnail

__all__ = ["dots_of"]

_LONG_SIDE = 300  # [pixels]
_SHORT_SIDE = 60  # at least
_HALF_DOT = 2
_MARGIN = 10
_PAPER, _DOT = (255, 255, 255), (45, 106, 159)


def dots_of(positions: FloatArray) -> Thumbnail | None:
    """Positions [m], shape (n, 2), in a frame that holds all of them; None: there is none."""
    if len(positions) == 0:
        return None
    lo, hi = positions.min(axis=0), positions.max(axis=0)
    extent = float((hi - lo).max())
    scale = (_LONG_SIDE - 2 * _MARGIN) / extent if extent else 1.0
    width, height = np.maximum(np.ceil((hi - lo) * scale) + 2 * _MARGIN, _SHORT_SIDE).astype(int)
    image = np.full((height, width, 3), _PAPER, np.uint8)
    middle = np.array([width, height]) / 2
    for x, y in np.rint((positions - (lo + hi) / 2) * scale + middle).astype(int):
        rows = slice(height - 1 - y - _HALF_DOT, height - y + _HALF_DOT)
        image[rows, x - _HALF_DOT : x + _HALF_DOT + 1] = _DOT
    wide = f"; the picture is {width / scale:.3g} m wide" if extent else ""
    return Thumbnail(image, f"each dot a landmark{wide}")
