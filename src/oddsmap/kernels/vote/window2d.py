# SPDX-License-Identifier: Apache-2.0
"""The window around a 2D scan, in which its votes are gathered before they go into tiles.

The ray loop touches no hash: cells are marked or counted in a dense window that covers the scan,
and the window is then swept once. A window too large to be held is cut into blocks, and the scan
is traced once per block; which block a cell falls in changes no bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.trace.clip_beams import ScanCells
from oddsmap.kernels.trace.segments2d import set_up

__all__ = ["DONE", "FULL", "OVERFLOW", "SLABS", "Room", "clear_margin", "describe", "window_box"]

DONE, FULL, OVERFLOW = 0, 1, 2
"""All scans done; more tiles must be made room for first; a cell passed MAX_UNITS."""

SLABS = 1024
"""About how many slabs are listed before their cells are marked."""


class Room(NamedTuple):
    """What the kernels here work in: they make no arrays of their own."""

    table: npt.NDArray[np.int64]
    """One scan's segments, shape (at least segments, COLUMNS)."""
    buffer: npt.NDArray[np.int32]
    """Segments' slabs, shape (2, at least SLABS + borders that one crosses + 10)."""
    units: npt.NDArray[np.int64]
    """One tile's hits and passes, shape (2, cells)."""
    box: npt.NDArray[np.int64]
    """A window, shape (4,)."""
    key: npt.NDArray[np.int64]
    """A tile's coordinates, shape (2,)."""
    band: npt.NDArray[np.integer]
    """The columns of a window, of the type of its marks or counts, shape (at least its width,)."""
    found: npt.NDArray[np.int64]
    """Tiles across a window, shape (at least so many, 2)."""


@borrowing
def describe(scans: ScanCells, bundle: int, table: npt.NDArray[np.int64]) -> None:
    """Set up the segments of a bundle."""
    ox, oy = scans.origins[bundle]
    first = scans.offsets[bundle]
    for i in range(first, scans.offsets[bundle + 1]):
        set_up(ox, oy, scans.fades[i, 0], scans.fades[i, 1], table, i - first)


@borrowing
def window_box(
    scans: ScanCells,
    scan: int,
    bundle: int,
    block: tuple[int, int],
    block_tiles: int,
    side: int,
    box: npt.NDArray[np.int64],
) -> bool:
    """Box of one block of the scan's window, relative to the bundle's first cell.

    Returns:
        True where it is not all of the window.
    """
    clipped = False
    for axis in range(2):
        cell = np.int64(math.floor(scans.origins[bundle, axis]))
        lo = scans.tiles_lo[scan, axis] + block[axis] * block_tiles
        hi = min(lo + block_tiles, scans.tiles_hi[scan, axis])
        clipped |= lo > scans.tiles_lo[scan, axis] or hi < scans.tiles_hi[scan, axis]
        box[2 * axis] = lo * side - cell
        box[2 * axis + 1] = hi * side - cell
    return clipped


@borrowing
def clear_margin(window: npt.NDArray[np.generic], stride: int, height: int) -> None:
    """Zero the margin of one cell around a window."""
    window[:stride] = 0
    window[(height + 1) * stride : (height + 2) * stride] = 0
    for row in range(1, height + 1):
        window[row * stride] = 0
        window[row * stride + stride - 1] = 0
