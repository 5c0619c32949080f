# SPDX-License-Identifier: Apache-2.0
"""Which part of the world a picture shows, in how many pixels.

The picture is laid out in whole pixels: a cell is k by k pixels or, in a map too large for that, a
pixel is b by b cells, so that no wall falls between two pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypedDict

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.map_files.fields import Grid

__all__ = ["Cells", "FrameOptions", "Layout", "layout_of", "positions_of"]

MIN_PIXELS = 1200  # long side of the map; small maps get several pixels per cell
MAX_PIXELS = 3800  # with the margins for the text it stays below 4000
_SIZES = (100, MAX_PIXELS)
_LONG_SIDE = 10.0  # [inch]; the text is sized for this, whatever the number of pixels
_SHORTEST, _PER_INCH = 4.0, 120.0  # of a picture whose size was asked for [inch, pixel/inch]
_MARGIN = 0.025  # of the long side, around the observed cells
_MIN_SIDE = 0.3  # a corridor is padded with unknown to this part of its length
# What lies beyond all but 1 in 1000 known cells along an axis is left out where that shortens the
# axis by a fifth: a few readings through a window shrink the rest to a stamp.
_FAR_SHARE, _SHORTER = 1e-3, 0.8


class FrameOptions(TypedDict, total=False):
    """What may be asked of any picture of a map.

    title: a line above it.
    trajectory: positions in the map frame [m], shape (n, 2), drawn as a line with a ring at its
        start and a dot at its end; a row with NaN interrupts it.
    crop: x_min, y_min, x_max, y_max of what is shown [m]; None: the known cells.
    size: pixels along the longer side of the map, 100 to 3800, or as many as whole pixels allow.
    whole: True: all known cells are shown, also the few that lie far from all others.
    """

    title: str | None
    trajectory: npt.ArrayLike | None
    crop: Sequence[float] | None
    size: int | None
    whole: bool


@dataclass(frozen=True, slots=True)
class Layout:
    """What is shown, and how large.

    Args:
        rows: shown rows of the grid.
        columns: shown columns of the grid.
        limits: x0, x1, y0, y1 of the map frame [m], margin included.
        block: cells per pixel, along each side.
        scale: pixels per cell, or per block.
        width: of the map [pixel].
        height: of the map [pixel].
        inches: the longer side of the map.
        outside: known cells that are left out as they lie far from the others.
        known: how many are known.
    """

    rows: slice
    columns: slice
    limits: tuple[float, float, float, float]
    block: int
    scale: int
    width: int
    height: int
    inches: float = _LONG_SIDE
    outside: int = 0
    known: int = 0


class _Span(NamedTuple):
    """Cells that are shown, and those outside them."""

    rows: slice
    columns: slice
    outside: int
    known: int


class Cells(NamedTuple):
    """Values of a rectangle of cells, as a `Grid` has probabilities."""

    probability: FloatArray
    observed: BoolArray
    resolution: float
    origin: tuple[float, float]
    yaw: float = 0.0


def layout_of(grid: Grid, options: FrameOptions) -> Layout:
    """Choose what is shown, in whole pixels.

    Raises:
        InputError: no cell is known, or none in the crop, or the grid of a crop is turned.
        ConfigError: the size is out of range.
    """
    crop, size = options.get("crop"), options.get("size")
    if size is not None and not _SIZES[0] <= size <= _SIZES[1]:
        raise ConfigError(f"size is {_SIZES[0]} to {_SIZES[1]} pixels, got {size}")
    if crop is not None:
        return _cropped(grid, crop, size)
    span = _known_span(grid, whole=options.get("whole", False))
    corners = np.array(
        [
            (x, y)
            for x in (span.columns.start, span.columns.stop)
            for y in (span.rows.start, span.rows.stop)
        ],
        float,
    )
    cos, sin = math.cos(grid.yaw), math.sin(grid.yaw)
    corners = corners @ np.array([[cos, sin], [-sin, cos]])  # in cells, axes of the map frame
    low, extent = corners.min(axis=0), np.ptp(corners, axis=0)
    longest = float(extent.max())
    pad = np.maximum(max(1.0, _MARGIN * longest), (_MIN_SIDE * longest - extent) / 2.0)
    return _in_pixels(grid, span, low, extent, pad, size)


def _in_pixels(
    grid: Grid, span: _Span, low: FloatArray, extent: FloatArray, pad: FloatArray, size: int | None
) -> Layout:
    longest = float(extent.max())
    most, least = (MAX_PIXELS, MIN_PIXELS) if size is None else (size, None)
    with_margin = (1.0 + 2.0 * _MARGIN) * longest if pad.any() else longest
    block = math.ceil(with_margin / most)
    if least is not None:
        scale = max(1, math.ceil(least / longest))  # pixels per cell
    else:
        scale = max(1, math.floor(most * block / (longest + 2.0 * float(pad.min()))))
    # A margin of whole blocks, so that the pixels of the picture are those of the cells.
    pad = block * np.ceil(pad / block)
    blocks = np.ceil((extent + 2.0 * pad) / block - 1e-6)  # not one more for a rounding error
    r = grid.resolution
    x0, y0 = np.array(grid.origin) + r * (low - pad)
    x1, y1 = np.array([x0, y0]) + r * block * blocks
    width, height = (int(n) * scale for n in blocks)
    inches = _LONG_SIDE
    if size is not None:
        inches = min(max(max(width, height) / _PER_INCH, _SHORTEST), _LONG_SIDE)
    limits = (float(x0), float(x1), float(y0), float(y1))
    return Layout(
        span.rows, span.columns, limits, block, scale, width, height, inches, span.outside,
        span.known,
    )  # fmt: skip


def _known_span(grid: Grid, *, whole: bool) -> _Span:
    """Rows and columns of the known cells, without the few that lie far out."""
    counts = [np.count_nonzero(grid.observed, axis=axis) for axis in (1, 0)]
    known = int(counts[0].sum()) if grid.observed.size else 0
    if not known:
        raise InputError("no cell of the map is observed, nothing to draw")
    rows, columns = (_span(count, far=0.0 if whole else _FAR_SHARE) for count in counts)
    inside = int(np.count_nonzero(grid.observed[rows, columns]))
    return _Span(rows, columns, known - inside, known)


def _span(counts: IntArray, far: float) -> slice:
    """From the first to the last row that counts."""
    used = np.flatnonzero(counts)
    first, last = int(used[0]), int(used[-1])
    before, room = np.cumsum(counts), 0.5 * far * counts.sum()
    low = int(np.searchsorted(before, room, side="right"))
    high = int(np.searchsorted(before, before[-1] - room, side="left"))
    if high - low + 1 < _SHORTER * (last - first + 1):
        more = math.ceil(_MARGIN * (high - low + 1))
        first, last = max(first, low - more), min(last, high + more)
    return slice(first, last + 1)


def _cropped(grid: Grid, crop: Sequence[float], size: int | None) -> Layout:
    box = np.asarray(crop, np.float64)
    if box.shape != (4,) or not np.isfinite(box).all() or not (box[:2] < box[2:]).all():
        raise ConfigError(
            "crop is x_min y_min x_max y_max [m], each minimum below its maximum, got "
            f"{np.ravel(box).tolist()}"
        )
    if grid.yaw != 0.0:
        raise InputError(f"the map is turned by {grid.yaw:g} rad: its cells make no such crop")
    place = (box.reshape(2, 2) - grid.origin) / grid.resolution
    low, high = np.floor(place[0] + 1e-9), np.ceil(place[1] - 1e-9)
    bounds = zip(low, high, grid.observed.shape[::-1], strict=True)
    columns, rows = (slice(*(int(np.clip(n, 0, most)) for n in (a, b))) for a, b, most in bounds)
    known = int(np.count_nonzero(grid.observed[rows, columns]))
    if not known:
        where = " ".join(f"{metres:g}" for metres in box)
        raise InputError(f"no cell of the map is known in the crop {where}")
    return _in_pixels(grid, _Span(rows, columns, 0, known), low, high - low, np.zeros(2), size)


def positions_of(trajectory: npt.ArrayLike | None) -> FloatArray | None:
    """A trajectory as an array, shape (n, 2).

    Raises:
        InputError: another shape.
    """
    line = None if trajectory is None else np.asarray(trajectory, dtype=np.float64)
    if line is not None and (line.ndim != 2 or line.shape[1] != 2):
        raise InputError(f"the trajectory must have shape (n, 2), got {line.shape}")
    return line
