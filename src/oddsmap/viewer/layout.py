# SPDX-License-Identifier: Apache-2.0
"""How the cells of any map lie in a payload, and how many may."""

from __future__ import annotations

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.limits import in_metres

__all__ = ["MOST_VOXELS", "TILE", "check_box", "check_span", "voxel_steps"]

TILE = 128
"""Cells along the side of a tile of the page."""

# The page finds a tile in a table of all places of the map's box: 4 bytes for each, and no longer
# along an axis than the textures of any graphics card.
_MOST_PLACES, _LONGEST_SIDE = 1 << 22, 4096

# Positions of voxels are counted from the first cell of the map, in 16 bits.
_POSITIONS = 1 << 16

MOST_VOXELS = 1 << 26
"""How many the page takes: they are 16 bytes and more each on the graphics card."""


def check_span(span: IntArray, resolution: float, name: str, remedy: str) -> None:
    """Refuse a 2D map that is too wide.

    Args:
        span: tiles along x and y.
        resolution: side of a cell [m].
        name: of the map's file.
        remedy: what to do.

    Raises:
        InputError: it is.
    """
    columns, rows = span.tolist()
    if columns * rows > _MOST_PLACES or max(columns, rows) > _LONGEST_SIDE:
        _refuse(span * TILE, resolution, name, remedy)


def check_box(lo: IntArray, hi: IntArray, resolution: float, name: str, remedy: str) -> None:
    """Refuse a 3D map that is too wide.

    Args:
        lo: its first cell.
        hi: one past its last.
        resolution: side of a cell [m].
        name: of the map's file.
        remedy: what to do.

    Raises:
        InputError: it is.
    """
    if (hi - lo).max() > _POSITIONS:
        _refuse(hi - lo, resolution, name, remedy)


def _refuse(cells: IntArray, resolution: float, name: str, remedy: str) -> None:
    sides = " x ".join(in_metres(n * resolution) for n in cells.tolist())
    raise InputError(f"{name}: the page cannot show {sides} m at {resolution:g} m; {remedy}")


def voxel_steps(index: IntArray, lo: IntArray) -> IntArray:
    """Positions of voxels: differences from the one before, modulo 65536, along each axis.

    Args:
        index: of voxels, shape (n, 3).
        lo: the first cell of the page's box, from which the first one is counted.
    """
    return np.diff(index - lo, axis=0, prepend=np.zeros((1, 3), np.int64)) % _POSITIONS
