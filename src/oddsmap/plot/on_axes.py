# SPDX-License-Identifier: Apache-2.0
"""Cells drawn into axes of Matplotlib, beside whatever else a figure shows."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias, TypedDict, Unpack

import numpy as np
import numpy.typing as npt

from oddsmap.map_files.fields import Grid
from oddsmap.plot import frame
from oddsmap.plot.layout import FrameOptions, layout_of, positions_of
from oddsmap.plot.picture import FREE, OCCUPIED, block_values
from oddsmap.plot.quantity import COLOURS, block_largest, limits_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LABEL = 38  # characters beside a colour bar in a line

_Shown: TypeAlias = "Callable[[Grid, tuple[slice, slice], int], npt.NDArray[np.float64]]"

__all__ = ["PlotOptions", "plot_probability", "plot_quantity"]

_SIZE = 2000  # more pixels than a figure has, and at 100 bytes each for Matplotlib enough


class PlotOptions(TypedDict, total=False):
    """What may be asked of a plot.

    title: a line above the axes.
    trajectory: positions in the map frame [m], shape (n, 2), drawn as a line with a ring at its
        start and a dot at its end; a row with NaN interrupts it.
    crop: x_min, y_min, x_max, y_max of what is shown [m]; None: the known cells.
    whole: True: all known cells are shown, also the few that lie far from all others.
    colour_bar: False: none is drawn.
    cmap: a colour map of Matplotlib, in place of white to black, or of viridis.
    """

    title: str | None
    trajectory: npt.ArrayLike | None
    crop: Sequence[float] | None
    whole: bool
    colour_bar: bool
    cmap: object


def plot_probability(
    grid: Grid,
    ax: Axes | None = None,
    *,
    label: str = "p(occupied)",
    **options: Unpack[PlotOptions],
) -> Axes:
    """Draw a map into axes: free white, occupied near black, unknown light blue.

    Args:
        grid: the map, at least one cell observed.
        ax: where; None: the current axes of pyplot.
        label: what grey means, beside the colour bar.
        options: see `PlotOptions`.

    Returns:
        The axes, in metres. A map too large for a figure has a pixel for a block of cells, as in
        `oddsmap.plot.picture.save_picture`.

    Raises:
        InputError: no cell is observed, or none in the crop, or the trajectory has another shape.
    """
    from matplotlib.colors import LinearSegmentedColormap

    greys = LinearSegmentedColormap.from_list(
        "oddsmap", [tuple(channel / 255.0 for channel in end) for end in (FREE, OCCUPIED)]
    )

    def shown(grid: Grid, part: tuple[slice, slice], block: int) -> npt.NDArray[np.float64]:
        value = np.where(grid.observed[part], grid.probability[part], -1.0).astype(np.float32)
        value = block_values(value, block)
        return np.where(value < 0.0, np.nan, value)

    options.setdefault("cmap", greys)
    return _plot(grid, ax, shown, label, (0.0, 1.0), "unknown", options)


def plot_quantity(
    grid: Grid,
    ax: Axes | None = None,
    *,
    label: str,
    limits: tuple[float, float] | None = None,
    missing: str = "unknown",
    **options: Unpack[PlotOptions],
) -> Axes:
    """Draw a quantity of the observed cells into axes; the others are light blue.

    Args:
        grid: the quantity, in the place of the probability; at least one cell observed.
        ax: where; None: the current axes of pyplot.
        label: what is drawn, with its unit, beside the colour bar.
        limits: values at the ends of the colour bar; None: 0 and the largest that occurs.
        missing: what the others are.
        options: see `PlotOptions`.

    Returns:
        The axes, in metres.

    Raises:
        InputError: as in `plot_probability`.
    """

    def shown(grid: Grid, part: tuple[slice, slice], block: int) -> npt.NDArray[np.float64]:
        return block_largest(np.where(grid.observed[part], grid.probability[part], np.nan), block)

    options.setdefault("cmap", COLOURS)
    return _plot(grid, ax, shown, label, limits, missing, options)


def _plot(
    grid: Grid,
    ax: Axes | None,
    shown: _Shown,
    label: str,
    limits: tuple[float, float] | None,
    missing: str,
    options: PlotOptions,
) -> Axes:
    from matplotlib.transforms import Affine2D

    line = positions_of(options.get("trajectory"))
    shows = FrameOptions(crop=options.get("crop"), whole=options.get("whole", False), size=_SIZE)
    layout = layout_of(grid, shows)
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.gca()
    value = shown(grid, (layout.rows, layout.columns), layout.block)
    low, high = limits or limits_of(value)
    side = grid.resolution * layout.block
    x, y = layout.columns.start * grid.resolution, layout.rows.start * grid.resolution
    ny, nx = value.shape
    image = ax.imshow(
        np.ma.masked_invalid(value),
        origin="lower",
        interpolation="nearest",
        interpolation_stage="data",
        cmap=options["cmap"],  # type: ignore[arg-type]  # a name that only Matplotlib knows
        vmin=low,
        vmax=high,
        extent=(x, x + side * nx, y, y + side * ny),
        transform=Affine2D().rotate(grid.yaw).translate(*grid.origin) + ax.transData,
    )
    ax.set_facecolor(frame.UNKNOWN)
    ax.set_xlim(*layout.limits[:2])
    ax.set_ylim(*layout.limits[2:])
    ax.set_aspect("equal")
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")
    if line is not None:
        frame.draw_trajectory(ax, line)
    if title := options.get("title"):
        ax.set_title(title, loc="left")  # what blue is stands at the right
    if layout.outside:
        note = f"not shown: {layout.outside:,} of {layout.known:,} known cells, far away"
        ax.annotate(note, (0.01, 0.01), xycoords="axes fraction", size=7, color=frame.INK)
    if options.get("colour_bar", True):
        words = textwrap.fill(label, _LABEL)
        bar = ax.figure.colorbar(image, ax=ax, label=words, fraction=0.046, pad=0.04)
        bar.outline.set_linewidth(0.6)
        _say_missing(ax, missing)
    return ax


def _say_missing(ax: Axes, missing: str) -> None:
    """What light blue is, above the right end of the axes."""
    from matplotlib.legend import Legend
    from matplotlib.patches import Patch

    patch = Patch(facecolor=frame.UNKNOWN, edgecolor=frame.INK, linewidth=0.6)
    # Not ax.legend: the caller may want one.
    legend = Legend(
        ax, [patch], [missing], loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False,
        fontsize="small", handlelength=1.0, handleheight=1.0, borderaxespad=0.1, borderpad=0.1,
    )  # fmt: skip
    ax.add_artist(legend)
