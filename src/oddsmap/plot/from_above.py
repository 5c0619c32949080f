# SPDX-License-Identifier: Apache-2.0
"""3D maps of leaves as they are seen from above: of a column the most occupied leaf.

A picture for people. Whether a robot fits through is what `oddsmap.project` says: under a roof this
shows the roof, and a column is free here as soon as its leaves are, however few.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.errors import InputError
from oddsmap.plot.thumbnail import MOST_PIXELS, Pictured, Thumbnail, of_probability

if TYPE_CHECKING:
    from typing import Unpack

    from matplotlib.axes import Axes

    from oddsmap.plot.on_axes import PlotOptions

__all__ = ["DrawnFromAbove", "largest_in_blocks"]

_MOST_SQUARES = 2000  # along a side of a plot, as other plots have pixels
_PAIRS = 1 << 20  # of leaves and blocks at a time
_MANY = 1 << 14  # blocks of a leaf, from which it is drawn alone


class _Leaves(Protocol):
    @property
    def index(self) -> IntArray: ...
    @property
    def side(self) -> IntArray: ...
    @property
    def probability(self) -> FloatArray: ...
    @property
    def resolution(self) -> float: ...


@dataclass(frozen=True, slots=True)
class _Squares:
    """A plane to be drawn, see `oddsmap.map_files.fields.Grid`."""

    probability: FloatArray
    observed: BoolArray
    resolution: float
    origin: tuple[float, float]
    yaw: float = 0.0


class DrawnFromAbove(Pictured):
    """Draws leaves with an `index`, a `side` and a `probability`. Made to be derived from."""

    __slots__ = ()

    def _thumbnail(self: _Leaves) -> Thumbnail | None:
        if len(self.index) == 0:
            return None
        lo, hi = _box_of(self.index, self.side)
        block = _block(lo, hi, MOST_PIXELS)
        value = largest_in_blocks(self.index, self.side, self.probability, lo, hi, block)
        return of_probability(value, "seen from above")

    def plot(
        self: _Leaves,
        ax: Axes | None = None,
        *,
        z_min: float = -np.inf,
        z_max: float = np.inf,
        **options: Unpack[PlotOptions],
    ) -> Axes:
        """Draw the map as seen from above into axes of Matplotlib.

        Of a column it shows the most occupied leaf in a band of heights; where it has none the
        column is unknown. `oddsmap.project` says what is in a robot's way.

        Args:
            ax: where; None: the current axes of pyplot.
            z_min: lower end of the band [m]; a cell belongs to it where its centre does.
            z_max: upper end of the band [m].
            options: title, trajectory, crop, whole, colour_bar, cmap: see
                `oddsmap.plot.on_axes.PlotOptions`.

        Raises:
            InputError: the map has nothing in the band, or as in
                `oddsmap.plot.on_axes.plot_probability`.
        """
        from oddsmap.plot.on_axes import plot_probability

        kept = _in_band(self, z_min, z_max)
        if not kept.any():
            raise InputError(
                f"no cell of the map is known from {z_min:g} to {z_max:g} m, nothing to draw"
            )
        index, side, p = self.index[kept], self.side[kept], self.probability[kept]
        lo, hi = _box_of(index, side)
        block = _block(lo, hi, _MOST_SQUARES)
        value = largest_in_blocks(index, side, p, lo, hi, block)
        x, y = (float(n) * self.resolution for n in lo)
        known = ~np.isnan(value)
        squares = _Squares(np.nan_to_num(value), known, self.resolution * block, (x, y))
        return plot_probability(squares, ax, label="largest p(occupied) of the column", **options)


def largest_in_blocks(
    index: IntArray,
    side: IntArray,
    value: FloatArray,
    lo: IntArray,
    hi: IntArray,
    block: int,
) -> npt.NDArray[np.float64]:
    """The largest value of the leaves that lie in each block of columns, or reach into it.

    Args:
        index: lowest cell of each leaf, shape (n, 3), x first.
        side: cells along the side of each, shape (n,).
        value: of each, shape (n,).
        lo: the first column, shape (2,); hi: past the last.
        hi: see lo.
        block: columns along the side of a block.

    Returns:
        Row = y ascending; NaN where no leaf is.
    """
    nx, ny = (-(-int(n) // block) for n in hi - lo)
    found = np.full((ny, nx), -np.inf)
    for size in np.unique(side):
        of_size = side == size
        first = (index[of_size, :2] - lo) // block
        last = (index[of_size, :2] + (size - 1) - lo) // block
        most = int(size - 1) // block + 2  # blocks that such a leaf may reach into
        if most**2 > _MANY:
            for (x, y), (right, top), p in zip(first, last, value[of_size], strict=True):
                part = found[y : top + 1, x : right + 1]
                np.maximum(part, p, out=part)
            continue
        step = np.arange(most)
        many = _PAIRS // most**2
        for start in range(0, len(first), many):
            some = slice(start, start + many)
            # Those that reach into fewer are asked twice for the last.
            x, y = np.minimum(first[some, None] + step[:, None], last[some, None]).T
            np.maximum.at(found, (y[:, None], x[None, :]), value[of_size][some])
    return np.where(np.isneginf(found), np.nan, found)


def _box_of(index: IntArray, side: IntArray) -> tuple[IntArray, IntArray]:
    return index[:, :2].min(axis=0), (index[:, :2] + side[:, None]).max(axis=0)


def _block(lo: IntArray, hi: IntArray, most: int) -> int:
    return -(-int((hi - lo).max()) // most)


def _in_band(leaves: _Leaves, z_min: float, z_max: float) -> BoolArray:
    """Leaves of which a cell has its centre in the band."""
    first = leaves.index[:, 2].astype(np.float64)
    # Of the cells of a leaf the lowest centre from z_min on, and whether it is one of the leaf.
    lowest = np.maximum(np.ceil(z_min / leaves.resolution - 0.5), first)
    kept: BoolArray = (lowest < first + leaves.side) & ((lowest + 0.5) * leaves.resolution < z_max)
    return kept
